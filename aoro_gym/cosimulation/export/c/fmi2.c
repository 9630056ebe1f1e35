/* The functional mock-up interface 2.0 for co-simulation around the twin. */

#include "fmi.h"

#define FMI AORO_API

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;
typedef int fmi2Status, fmi2Type, fmi2StatusKind;

typedef void (*fmi2CallbackLogger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);

typedef struct {
    fmi2CallbackLogger logger;
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

#define CO_SIMULATION 1
#define LAST_SUCCESSFUL_TIME 2
#define TERMINATED_STATUS 3

/* Reasons are written out before they are handed on, and hold no per cent sign: importers that take the message as it is
 * and those that format it show the same. */
static void report2(struct instance *one, int status, const char *reason)
{
    static const char *const categories[] = {
        "logAll", "logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"};
    if (one->logger.call != NULL)
        ((fmi2CallbackLogger)one->logger.call)(one->environment, one->name, status, categories[status], reason);
}

FMI const char *fmi2GetTypesPlatform(void) { return "default"; }
FMI const char *fmi2GetVersion(void) { return "2.0"; }

FMI fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                  const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources;
    (void)visible;
    struct instance *one = type == CO_SIMULATION ? born(name, guid) : NULL;
    if (one == NULL) {
        if (callbacks != NULL && callbacks->logger != NULL)
            callbacks->logger(callbacks->componentEnvironment, name, ERROR, "logStatusError",
                              type != CO_SIMULATION ? "this unit is for co-simulation only"
                                                    : "there is no memory, or the guid is not this unit's");
        return NULL;
    }
    one->log = report2;
    one->logging = logging;
    if (callbacks != NULL) {
        one->logger.call = (void (*)(void))callbacks->logger;
        one->environment = callbacks->componentEnvironment;
    }
    return one;
}

FMI void fmi2FreeInstance(fmi2Component c) { buried(c); }

FMI fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    (void)count;
    (void)categories;
    ((struct instance *)c)->logging = on;
    return OK;
}

FMI fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                                   fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    struct instance *one = c;
    (void)toleranceDefined;
    (void)tolerance;
    (void)stopTimeDefined;
    (void)stopTime;
    if (!may(one, "fmi2SetupExperiment", IN(INSTANTIATED))) return ERROR;
    if (!isfinite(startTime)) return tell(one, ERROR, "the start time is %g s, but must be finite", startTime);
    one->start = startTime;
    return OK;
}

FMI fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    struct instance *one = c;
    if (!may(one, "fmi2EnterInitializationMode", IN(INSTANTIATED))) return ERROR;
    one->phase = INITIALIZING;
    return OK;
}

FMI fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    struct instance *one = c;
    if (!may(one, "fmi2ExitInitializationMode", IN(INITIALIZING)) || settle(one) != OK) return ERROR;
    one->phase = STEPPING;
    return OK;
}

FMI fmi2Status fmi2Terminate(fmi2Component c)
{
    struct instance *one = c;
    if (!may(one, "fmi2Terminate", IN(STEPPING) | IN(FAILED))) return ERROR;
    one->phase = TERMINATED;
    return OK;
}

FMI fmi2Status fmi2Reset(fmi2Component c) { return renew(c); }

FMI fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference references[], size_t count, fmi2Real values[])
{
    for (size_t i = 0; i < count; i++)
        if (get(c, references[i], 0, &values[i]) != OK) return ERROR;
    return OK;
}

FMI fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference references[], size_t count, fmi2Integer values[])
{
    for (size_t i = 0; i < count; i++) {
        double value;
        if (get(c, references[i], 1, &value) != OK) return ERROR;
        values[i] = (int)value;
    }
    return OK;
}

FMI fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference references[], size_t count, const fmi2Real values[])
{
    if (!may(c, "fmi2SetReal", IN(INSTANTIATED) | IN(INITIALIZING) | IN(STEPPING))) return ERROR;
    for (size_t i = 0; i < count; i++)
        if (set(c, references[i], 0, values[i]) != OK) return ERROR;
    return OK;
}

FMI fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference references[], size_t count,
                              const fmi2Integer values[])
{
    if (!may(c, "fmi2SetInteger", IN(INSTANTIATED) | IN(INITIALIZING) | IN(STEPPING))) return ERROR;
    for (size_t i = 0; i < count; i++)
        if (set(c, references[i], 1, values[i]) != OK) return ERROR;
    return OK;
}

FMI fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real size, fmi2Boolean noStateBefore)
{
    (void)noStateBefore;
    return may(c, "fmi2DoStep", IN(STEPPING)) ? step(c, point, size) : ERROR;
}

FMI fmi2Status fmi2CancelStep(fmi2Component c) { return tell(c, ERROR, "no step is ever pending"); }

/* --- states --- */

FMI fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) { return hand_out_state(c, state); }

FMI fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) { return restore(c, state, state_size()); }

FMI fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    return free_state(state);
}

FMI fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c;
    (void)state;
    *size = state_size();
    return OK;
}

FMI fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    return serialize(c, state, bytes, size);
}

FMI fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    return deserialize(c, bytes, size, state);
}

/* --- status --- */

FMI fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != LAST_SUCCESSFUL_TIME) return DISCARD;
    *value = now(c);
    return OK;
}

FMI fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    (void)c;
    if (kind != TERMINATED_STATUS) return DISCARD;
    *value = 0;
    return OK;
}

FMI fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)c;
    (void)kind;
    (void)value;
    return DISCARD;
}

FMI fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    return fmi2GetStatus(c, kind, value);
}

FMI fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)c;
    (void)kind;
    *value = "";
    return DISCARD;
}

/* --- what this unit has none of --- */

static int none(fmi2Component c, size_t count, const char *what)
{
    return count == 0 ? OK : tell(c, ERROR, "this unit has no %s", what);
}

FMI fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t count, fmi2Boolean values[])
{
    (void)r;
    (void)values;
    return none(c, count, "booleans");
}

FMI fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t count, const fmi2Boolean values[])
{
    (void)r;
    (void)values;
    return none(c, count, "booleans");
}

FMI fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t count, fmi2String values[])
{
    (void)r;
    (void)values;
    return none(c, count, "strings");
}

FMI fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t count, const fmi2String values[])
{
    (void)r;
    (void)values;
    return none(c, count, "strings");
}

FMI fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                            const fmi2ValueReference known[], size_t knowns, const fmi2Real change[],
                                            fmi2Real values[])
{
    (void)unknown;
    (void)known;
    (void)knowns;
    (void)change;
    (void)values;
    return none(c, unknowns, "derivatives");
}

FMI fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t count,
                                           const fmi2Integer orders[], const fmi2Real values[])
{
    (void)r;
    (void)orders;
    (void)values;
    return none(c, count, "derivatives of inputs: inputs hold over a step");
}

FMI fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t count,
                                            const fmi2Integer orders[], fmi2Real values[])
{
    (void)r;
    (void)orders;
    (void)values;
    return none(c, count, "derivatives of outputs");
}
