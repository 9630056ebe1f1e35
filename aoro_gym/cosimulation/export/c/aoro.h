/* The digital twin of the machine '@machine@' as a library of C: libc and libm are all that it needs.
 *
 *     aoro *twin = aoro_new();
 *     aoro_set(twin, AORO_INITIAL_JOINT_ANGLE, -0.6);    parameters first ...
 *     aoro_reset(twin);                                  ... then the machine stands at rest
 *     aoro_set(twin, AORO_STEERING_SIGNAL, 1.0);         commands hold until they are set again
 *     aoro_advance(twin, 10);                            10 ms
 *     double angle = aoro_get(twin, AORO_JOINT_ANGLE);
 *     aoro_free(twin);
 *
 * World and body frames are x forward, y left, z up; joint angle and steering signal are positive to the left; pressures
 * are gauge. Commands and outputs are SI, parameters in the unit of the machine file. Wheels are front left, front right,
 * rear left, rear right. Twins share nothing: each may have a thread of its own; one twin is for one thread at a time. */

#ifndef AORO_H
#define AORO_H

#include <stddef.h>

#if defined(__GNUC__)
#define AORO_API __attribute__((visibility("default")))
#else
#define AORO_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef struct aoro aoro;

/* What a call came to. After AORO_REFUSED everything is as it was; after AORO_DIVERGED the twin is frozen, and
 * aoro_reset or aoro_restore gives it life again. aoro_message has the reason of both. */
typedef enum { AORO_OK = 0, AORO_REFUSED = 1, AORO_DIVERGED = 2 } aoro_status;

typedef enum { AORO_INPUT, AORO_OUTPUT, AORO_PARAMETER } aoro_kind;

/* All variables: commands, outputs, parameters. */
typedef enum {
/* variables */
    AORO_VARIABLES
} aoro_variable;

/* A twin that has its start values and stands nowhere yet; NULL if there is no memory. */
AORO_API aoro *aoro_new(void);
AORO_API void aoro_free(aoro *twin);

/* Back to what aoro_new gives: parameters and commands at their start values. */
AORO_API void aoro_renew(aoro *twin);

/* Set a command, which holds from the next step on, or a parameter, which takes effect at the next aoro_reset. Refused:
 * what is not finite or out of its bounds, and outputs. */
AORO_API aoro_status aoro_set(aoro *twin, aoro_variable variable, double value);

/* Value of a variable; of an output at the end of the last step. At rest, before the first step, what the last step bore
 * (wheel_load_..., hull_force) is zero. NaN if there is no such variable. */
AORO_API double aoro_get(const aoro *twin, aoro_variable variable);

/* Put the machine at rest on the ground with idle circuits, at time 0. Refused: parameters that no machine can have, or
 * with which its circuits would be unstable. */
AORO_API aoro_status aoro_reset(aoro *twin);

/* Advance by whole milliseconds, at least one; commands are constant meanwhile. */
AORO_API aoro_status aoro_advance(aoro *twin, int milliseconds);

/* Why the last call was refused, or the twin diverged; in English, one line. */
AORO_API const char *aoro_message(const aoro *twin);

/* State of a twin as bytes: commands, parameters and all. Restoring refuses what is not of this very library. */
AORO_API size_t aoro_state_size(void);
AORO_API void aoro_save(const aoro *twin, void *bytes);
AORO_API aoro_status aoro_restore(aoro *twin, const void *bytes, size_t size);

/* Name, unit ("1" if none) and kind of a variable; NULL, NULL and AORO_OUTPUT if there is none such. */
AORO_API const char *aoro_name(aoro_variable variable);
AORO_API const char *aoro_unit(aoro_variable variable);
AORO_API aoro_kind aoro_kind_of(aoro_variable variable);

/* Variable of a name, such as "steering.valve.spool_time_constant"; AORO_VARIABLES if there is none such. */
AORO_API aoro_variable aoro_find(const char *name);

#ifdef __cplusplus
}
#endif

#endif
