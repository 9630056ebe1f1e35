/* The twin behind aoro.h: its tables come from aoro_model.h, which is written for one machine and ground, its physics from
 * the kernels that Warp compiled. */

#include "aoro.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "aoro_token.h"
#include "closure.h"

/* --- what Warp's kernels take and need --- */

struct warp_array {
    void *data;
    void *grad;
    int32_t shape[4];
    int32_t strides[4];
    uint16_t dimensions;
    uint16_t flags;
};

struct launch_bounds {
    uint32_t shape[1];
    size_t size;
    size_t coord_mult;
};

int _wp_isfinite(double x) { return isfinite(x); }

/* An array (first, second, third) of items of some bytes each; sizes that are not used are 0. */
static struct warp_array array(void *data, int item, int first, int second, int third)
{
    struct warp_array out = {data, NULL, {first, second, third, 0}, {0, 0, 0, 0}, 1, 0};
    const int tail = third > 0 ? third : 1;
    out.dimensions = (uint16_t)(third > 0 ? 3 : second > 0 ? 2 : 1);
    out.strides[0] = item * (second > 0 ? second : 1) * tail;
    if (second > 0) out.strides[1] = item * tail;
    if (third > 0) out.strides[2] = item;
    return out;
}

/* --- variables --- */

struct variable {
    const char *name, *unit;
    aoro_kind kind;
    int whole;     /* whether it is an integer */
    double start;  /* in the unit */
    double factor; /* size of the unit in SI */
    double low, high; /* [SI] */
    int low_open, high_open;
    const char *bounds; /* in words */
};

static double si(const double *parameters, int variable);

#include "aoro_model.h"

static double si(const double *parameters, int variable)
{
    return parameters[variable - AORO_FIRST_PARAMETER] * variables[variable].factor;
}

/* --- the twin --- */

struct model { /* all that the next steps depend on */
    double parameters[AORO_PARAMETERS];
    double inputs[AORO_INPUTS];
    struct machine_record machine;
    struct ground_record ground;
    float state[STATE_ROWS];
    float commands[AORO_INPUTS];
    float history[HISTORY_ROWS];
    float outputs[OUTPUT_ROWS];
    int32_t clock;
    int32_t status;
    int32_t stands; /* whether it was put on the ground */
};

struct aoro {
    struct model now;
    char message[400];
};

struct saved {
    char token[sizeof AORO_TOKEN];
    struct model model;
};

#if ON_TERRAIN
extern unsigned char aoro_nodes[], aoro_cover[], aoro_ceilings[];
#define GROUND_ARRAYS(arguments, ground)                                                     \
    do {                                                                                     \
        const int nodes = (ground)->rows * (ground)->columns;                                \
        (arguments)->terrain.terrains = array(ground, sizeof *(ground), 1, 0, 0);            \
        (arguments)->terrain.nodes = array(aoro_nodes, 16, nodes, 0, 0);                     \
        (arguments)->terrain.cover = array(aoro_cover, 8, nodes, 0, 0);                      \
        (arguments)->terrain.ceilings = array(aoro_ceilings, 4, nodes, 0, 0);                \
    } while (0)
#else
#define GROUND_ARRAYS(arguments, ground) ((void)0)
#endif

static aoro_status refuse(aoro *twin, const char *reason)
{
    snprintf(twin->message, sizeof twin->message, "%s", reason);
    return AORO_REFUSED;
}

static void place(struct model *now, float pose[4])
{
    struct launch_bounds one = {{1}, 1, 1};
    struct reset_arguments told;
    uint8_t mask = 1;
    int32_t terrain = -1; /* stay where it is */
    memset(&told, 0, sizeof told);
    told.machines = array(&now->machine, sizeof now->machine, 1, 0, 0);
    told.terrain.twins = array(&now->ground, sizeof now->ground, 1, 0, 0);
    GROUND_ARRAYS(&told, &now->ground);
    told.mask = array(&mask, sizeof mask, 1, 0, 0);
    told.pose = array(pose, sizeof *pose, 4, 1, 0);
    told.numbers = array(&terrain, sizeof terrain, 1, 0, 0);
    told.state = array(now->state, sizeof *now->state, STATE_ROWS, 1, 0);
    told.commands = array(now->commands, sizeof *now->commands, AORO_INPUTS, 1, 0);
    told.history = array(now->history, sizeof *now->history, HISTORY_ROWS, 1, 0);
    told.clock = array(&now->clock, sizeof now->clock, 1, 0, 0);
    told.status = array(&now->status, sizeof now->status, 1, 0, 0);
    reset_kernel(&one, &told);
}

static void move(struct model *now, int milliseconds)
{
    struct launch_bounds one = {{1}, 1, 1};
    struct advance_arguments told;
    for (int i = 0; i < AORO_INPUTS; i++) now->commands[i] = (float)now->inputs[i];
    memset(&told, 0, sizeof told);
    told.machines = array(&now->machine, sizeof now->machine, 1, 0, 0);
    told.terrain.twins = array(&now->ground, sizeof now->ground, 1, 0, 0);
    GROUND_ARRAYS(&told, &now->ground);
    told.commands = array(now->commands, sizeof *now->commands, 1, AORO_INPUTS, 1);
    told.state = array(now->state, sizeof *now->state, STATE_ROWS, 1, 0);
    told.history = array(now->history, sizeof *now->history, HISTORY_ROWS, 1, 0);
    told.clock = array(&now->clock, sizeof now->clock, 1, 0, 0);
    told.status = array(&now->status, sizeof now->status, 1, 0, 0);
    told.outputs = array(now->outputs, sizeof *now->outputs, 1, OUTPUT_ROWS, 1);
    told.num_frames = 1;
    told.frame_steps = milliseconds;
    told.num_substeps = SUBSTEPS;
    told.h = (float)MAIN_STEP;
    advance_kernel(&one, &told);
}

aoro *aoro_new(void)
{
    aoro *twin = calloc(1, sizeof *twin);
    if (twin != NULL) aoro_renew(twin);
    return twin;
}

void aoro_free(aoro *twin) { free(twin); }

void aoro_renew(aoro *twin)
{
    memset(twin, 0, sizeof *twin);
    for (int i = 0; i < AORO_PARAMETERS; i++) twin->now.parameters[i] = variables[AORO_FIRST_PARAMETER + i].start;
    for (int i = 0; i < AORO_INPUTS; i++) twin->now.inputs[i] = variables[AORO_FIRST_INPUT + i].start;
}

static int admits(const struct variable *one, double value)
{
    const double x = value * one->factor;
    const int above = one->low_open ? x > one->low : x >= one->low;
    const int below = one->high_open ? x < one->high : x <= one->high;
    return isfinite(value) && above && below && (!one->whole || value == floor(value));
}

aoro_status aoro_set(aoro *twin, aoro_variable variable, double value)
{
    const int i = (int)variable;
    if (i < 0 || i >= AORO_VARIABLES) return refuse(twin, "there is no variable of this number");
    const struct variable *one = &variables[i];
    if (one->kind == AORO_OUTPUT) {
        snprintf(twin->message, sizeof twin->message, "%s is an output, which cannot be set", one->name);
        return AORO_REFUSED;
    }
    if (!admits(one, value)) {
        const int bare = strcmp(one->unit, "1") == 0;
        snprintf(twin->message, sizeof twin->message, "%s is %.10g%s%s, but must be %s", one->name, value,
                 bare ? "" : " ", bare ? "" : one->unit, one->bounds);
        return AORO_REFUSED;
    }
    if (one->kind == AORO_PARAMETER) twin->now.parameters[i - AORO_FIRST_PARAMETER] = value;
    else twin->now.inputs[i - AORO_FIRST_INPUT] = value;
    return AORO_OK;
}

double aoro_get(const aoro *twin, aoro_variable variable)
{
    const int i = (int)variable;
    if (i < 0 || i >= AORO_VARIABLES) return NAN;
    if (i == AORO_TIME) return twin->now.clock * MAIN_STEP;
    switch (variables[i].kind) {
    case AORO_INPUT: return twin->now.inputs[i - AORO_FIRST_INPUT];
    case AORO_PARAMETER: return twin->now.parameters[i - AORO_FIRST_PARAMETER];
    default: return twin->now.outputs[output_rows[i - AORO_FIRST_OUTPUT]];
    }
}

aoro_status aoro_reset(aoro *twin)
{
    struct model then = twin->now;
    const char *reason = derive(then.parameters, &then.machine);
    if (reason != NULL) return refuse(twin, reason);
    const double range = si(then.parameters, AORO_JOINT_RANGE);
    const double angle = si(then.parameters, AORO_INITIAL_JOINT_ANGLE);
    if (fabs(angle) > range + 1e-6) {
        snprintf(twin->message, sizeof twin->message,
                 "initial.joint_angle is %.4f rad, but the joint reaches only +-%.4f rad (joint.range)", angle, range);
        return AORO_REFUSED;
    }
    float pose[4] = {
        (float)si(then.parameters, AORO_INITIAL_X),
        (float)si(then.parameters, AORO_INITIAL_Y),
        (float)si(then.parameters, AORO_INITIAL_HEADING),
        (float)angle,
    };
    lay_ground(then.parameters, &then.ground);
    place(&then, pose);
    then.stands = 1;
    twin->now = then;
    move(&then, 0); /* outputs at rest; the state that this leaves is not taken */
    memcpy(twin->now.outputs, then.outputs, sizeof then.outputs);
    twin->message[0] = '\0';
    return AORO_OK;
}

static aoro_status diverged(aoro *twin)
{
    snprintf(twin->message, sizeof twin->message, "simulation diverged (non-finite state at t = %.3f s)",
             twin->now.clock * MAIN_STEP);
    return AORO_DIVERGED;
}

aoro_status aoro_advance(aoro *twin, int milliseconds)
{
    if (!twin->now.stands) return refuse(twin, "the machine stands nowhere yet; call aoro_reset first");
    if (milliseconds < 1) return refuse(twin, "the step must be at least 1 ms");
    if (twin->now.clock > INT32_MAX - milliseconds) return refuse(twin, "the clock ends after 24 days; reset the twin");
    if (twin->now.status != 0) return diverged(twin);
    move(&twin->now, milliseconds);
    return twin->now.status != 0 ? diverged(twin) : AORO_OK;
}

const char *aoro_message(const aoro *twin) { return twin->message; }

size_t aoro_state_size(void) { return sizeof(struct saved); }

void aoro_save(const aoro *twin, void *bytes)
{
    memset(bytes, 0, sizeof(struct saved));
    memcpy((char *)bytes + offsetof(struct saved, token), AORO_TOKEN, sizeof AORO_TOKEN);
    memcpy((char *)bytes + offsetof(struct saved, model), &twin->now, sizeof twin->now);
}

aoro_status aoro_restore(aoro *twin, const void *bytes, size_t size)
{
    if (size != sizeof(struct saved) || memcmp(bytes, AORO_TOKEN, sizeof AORO_TOKEN) != 0)
        return refuse(twin, "these bytes are no state of this library");
    memcpy(&twin->now, (const char *)bytes + offsetof(struct saved, model), sizeof twin->now);
    return AORO_OK;
}

const char *aoro_name(aoro_variable variable)
{
    return (unsigned)variable < AORO_VARIABLES ? variables[variable].name : NULL;
}

const char *aoro_unit(aoro_variable variable)
{
    return (unsigned)variable < AORO_VARIABLES ? variables[variable].unit : NULL;
}

aoro_kind aoro_kind_of(aoro_variable variable)
{
    return (unsigned)variable < AORO_VARIABLES ? variables[variable].kind : AORO_OUTPUT;
}

aoro_variable aoro_find(const char *name)
{
    int i = 0;
    while (i < AORO_VARIABLES && strcmp(variables[i].name, name) != 0) i++;
    return (aoro_variable)i;
}
