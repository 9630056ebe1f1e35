/* What FMI 2.0 and 3.0 share: an instance in its phases around a twin. */

#ifndef AORO_FMI_H
#define AORO_FMI_H

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "aoro.h"
#include "aoro_token.h"

#define STEP 0.001 /* [s] of the bodies */
#define LATE 1e-6  /* share of a step by which a step size may miss a whole number of them */

enum phase { INSTANTIATED, INITIALIZING, STEPPING, FAILED, TERMINATED };

/* What the standard's status numbers mean in both versions. */
enum { OK = 0, WARNING = 1, DISCARD = 2, ERROR = 3, FATAL = 4 };

struct instance {
    aoro *twin;
    enum phase phase;
    int stands;        /* whether the twin was put on the ground since the last parameter was set */
    double start;      /* [s] time of the importer at which the twin's is 0 */
    int logging;
    char *name;
    char reason[500];
    void (*log)(struct instance *, int status, const char *reason);
    void *environment; /* the importer's */
    union {
        void (*call)(void);
    } logger;
};

static int tell(struct instance *one, int status, const char *format, ...)
{
    va_list values;
    va_start(values, format);
    vsnprintf(one->reason, sizeof one->reason, format, values);
    va_end(values);
    if (one->logging || status >= DISCARD) one->log(one, status, one->reason);
    return status;
}

/* An error after which only reset, a restored state and the end are left. */
static int fail(struct instance *one, const char *reason)
{
    one->phase = FAILED;
    return tell(one, ERROR, "%s", reason);
}

static int may(struct instance *one, const char *call, unsigned phases)
{
    if (phases & (1u << one->phase)) return 1;
    static const char *const names[] = {"instantiated", "in initialization mode", "in step mode", "failed", "terminated"};
    tell(one, ERROR, "%s must not be called while the instance is %s", call, names[one->phase]);
    return 0;
}

#define IN(phase) (1u << (phase))

/* Put the twin on the ground if a parameter or nothing was set since it was. */
static int settle(struct instance *one)
{
    if (one->stands) return OK;
    if (aoro_reset(one->twin) != AORO_OK) return fail(one, aoro_message(one->twin));
    one->stands = 1;
    return OK;
}

static int is_whole(unsigned reference) { return reference == AORO_GEAR; }

static int get(struct instance *one, unsigned reference, int whole, double *value)
{
    if (reference >= AORO_VARIABLES || is_whole(reference) != whole)
        return tell(one, ERROR, "there is no variable of this type with the value reference %u", reference);
    if (aoro_kind_of(reference) == AORO_OUTPUT && one->phase == INITIALIZING && settle(one) != OK) return ERROR;
    *value = aoro_get(one->twin, reference);
    if (reference == AORO_TIME) *value += one->start;
    return OK;
}

static int set(struct instance *one, unsigned reference, int whole, double value)
{
    if (reference >= AORO_VARIABLES || is_whole(reference) != whole)
        return tell(one, ERROR, "there is no variable of this type with the value reference %u", reference);
    if (aoro_kind_of(reference) == AORO_PARAMETER) {
        if (one->phase != INSTANTIATED && one->phase != INITIALIZING)
            return tell(one, ERROR, "%s is a parameter, fixed once the machine stands", aoro_name(reference));
        one->stands = 0;
    }
    if (aoro_set(one->twin, reference, value) != AORO_OK) return tell(one, ERROR, "%s", aoro_message(one->twin));
    return OK;
}

/* Time of the importer [s] that the twin has come to. */
static double now(const struct instance *one) { return one->start + aoro_get(one->twin, AORO_TIME); }

static int step(struct instance *one, double point, double size)
{
    const double count = isfinite(size) ? round(size / STEP) : 0.0;
    if (!(fabs(point - now(one)) < 0.5 * STEP))
        return tell(one, DISCARD, "the step begins at %.9g s, but the twin is at %.9g s", point, now(one));
    if (count < 1.0 || count > 1e9 || fabs(count * STEP - size) > LATE * STEP * count)
        return tell(one, DISCARD, "the step size is %.9g s, but must be a positive whole multiple of 0.001 s", size);
    const aoro_status done = aoro_advance(one->twin, (int)count);
    if (done == AORO_DIVERGED) return fail(one, aoro_message(one->twin));
    if (done != AORO_OK) return tell(one, DISCARD, "%s", aoro_message(one->twin));
    return OK;
}

static int renew(struct instance *one)
{
    aoro_renew(one->twin);
    one->phase = INSTANTIATED;
    one->stands = 0;
    one->start = 0.0;
    return OK;
}

/* --- state of an instance as bytes --- */

struct state_head {
    int phase, stands;
    double start;
};

static size_t state_size(void) { return sizeof(struct state_head) + aoro_state_size(); }

static void save(const struct instance *one, void *bytes)
{
    const struct state_head head = {one->phase, one->stands, one->start};
    memcpy(bytes, &head, sizeof head);
    aoro_save(one->twin, (char *)bytes + sizeof head);
}

static int restore(struct instance *one, const void *bytes, size_t size)
{
    struct state_head head;
    if (bytes == NULL || size != state_size()) return tell(one, ERROR, "the state is none of this unit");
    memcpy(&head, bytes, sizeof head);
    if (aoro_restore(one->twin, (const char *)bytes + sizeof head, size - sizeof head) != AORO_OK)
        return tell(one, ERROR, "%s", aoro_message(one->twin));
    one->phase = (enum phase)head.phase;
    one->stands = head.stands;
    one->start = head.start;
    return OK;
}

/* The calls of both versions, whose states are bytes of their own. */

static int hand_out_state(struct instance *one, void **state)
{
    if (*state == NULL) *state = malloc(state_size());
    if (*state == NULL) return tell(one, ERROR, "there is no memory for a state");
    save(one, *state);
    return OK;
}

static int free_state(void **state)
{
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return OK;
}

static int serialize(struct instance *one, const void *state, void *bytes, size_t size)
{
    if (state == NULL || size < state_size()) return tell(one, ERROR, "the serialized state has %zu bytes", state_size());
    memcpy(bytes, state, state_size());
    return OK;
}

static int deserialize(struct instance *one, const void *bytes, size_t size, void **state)
{
    if (size != state_size()) return tell(one, ERROR, "the state is none of this unit");
    if (*state == NULL) *state = malloc(size);
    if (*state == NULL) return tell(one, ERROR, "there is no memory for a state");
    memcpy(*state, bytes, size);
    return OK;
}

/* --- birth and death --- */

static struct instance *born(const char *name, const char *token)
{
    if (name == NULL || token == NULL || strcmp(token, AORO_TOKEN) != 0) return NULL;
    struct instance *one = calloc(1, sizeof *one);
    if (one == NULL) return NULL;
    one->twin = aoro_new();
    one->name = malloc(strlen(name) + 1);
    if (one->twin == NULL || one->name == NULL) {
        aoro_free(one->twin);
        free(one->name);
        free(one);
        return NULL;
    }
    strcpy(one->name, name);
    return one;
}

static void buried(struct instance *one)
{
    if (one == NULL) return;
    aoro_free(one->twin);
    free(one->name);
    free(one);
}

#endif
