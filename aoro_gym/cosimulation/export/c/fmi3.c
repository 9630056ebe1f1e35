/* The functional mock-up interface 3.0 for co-simulation around the twin. */

#include "fmi.h"

#include <stdbool.h>
#include <stdint.h>

#define FMI AORO_API

typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef double fmi3Float64;
typedef int32_t fmi3Int32;
typedef bool fmi3Boolean;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef int fmi3Status;

typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean, fmi3Boolean *, fmi3Float64 *);

static void report3(struct instance *one, int status, const char *reason)
{
    static const char *const categories[] = {
        "logAll", "logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"};
    if (one->logger.call != NULL)
        ((fmi3LogMessageCallback)one->logger.call)(one->environment, status, categories[status], reason);
}

FMI const char *fmi3GetVersion(void) { return "3.0"; }

FMI fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean eventMode, fmi3Boolean earlyReturn, const fmi3ValueReference intermediate[], size_t intermediates,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    (void)resources;
    (void)visible;
    (void)earlyReturn;
    (void)intermediate;
    (void)intermediates;
    (void)update;
    struct instance *one = eventMode ? NULL : born(name, token);
    if (one == NULL) {
        if (log != NULL)
            log(environment, ERROR, "logStatusError",
                eventMode ? "this unit has no event mode"
                          : "there is no memory, or the instantiation token is not this unit's");
        return NULL;
    }
    one->log = report3;
    one->logging = logging;
    one->logger.call = (void (*)(void))log;
    one->environment = environment;
    return one;
}

FMI fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                              fmi3Boolean visible, fmi3Boolean logging,
                                              fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging;
    if (log != NULL) log(environment, ERROR, "logStatusError", "this unit is for co-simulation only");
    return NULL;
}

FMI fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, void (*tick)(fmi3InstanceEnvironment),
    void (*lock)(void), void (*unlock)(void))
{
    (void)tick;
    (void)lock;
    (void)unlock;
    return fmi3InstantiateModelExchange(name, token, resources, visible, logging, environment, log);
}

FMI void fmi3FreeInstance(fmi3Instance c) { buried(c); }

FMI fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    (void)count;
    (void)categories;
    ((struct instance *)c)->logging = on;
    return OK;
}

FMI fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                           fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    struct instance *one = c;
    (void)toleranceDefined;
    (void)tolerance;
    (void)stopTimeDefined;
    (void)stopTime;
    if (!may(one, "fmi3EnterInitializationMode", IN(INSTANTIATED))) return ERROR;
    if (!isfinite(startTime)) return tell(one, ERROR, "the start time is %g s, but must be finite", startTime);
    one->start = startTime;
    one->phase = INITIALIZING;
    return OK;
}

FMI fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    struct instance *one = c;
    if (!may(one, "fmi3ExitInitializationMode", IN(INITIALIZING)) || settle(one) != OK) return ERROR;
    one->phase = STEPPING;
    return OK;
}

FMI fmi3Status fmi3Terminate(fmi3Instance c)
{
    struct instance *one = c;
    if (!may(one, "fmi3Terminate", IN(STEPPING) | IN(FAILED))) return ERROR;
    one->phase = TERMINATED;
    return OK;
}

FMI fmi3Status fmi3Reset(fmi3Instance c) { return renew(c); }

FMI fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 point, fmi3Float64 size, fmi3Boolean noStateBefore,
                          fmi3Boolean *eventNeeded, fmi3Boolean *terminate, fmi3Boolean *earlyReturn,
                          fmi3Float64 *lastSuccessfulTime)
{
    (void)noStateBefore;
    if (!may(c, "fmi3DoStep", IN(STEPPING))) return ERROR;
    const int status = step(c, point, size);
    *eventNeeded = *terminate = *earlyReturn = false;
    *lastSuccessfulTime = now(c);
    return status;
}

/* --- values --- */

FMI fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference references[], size_t count, fmi3Float64 values[],
                              size_t sizes)
{
    if (count != sizes) return tell(c, ERROR, "all variables are scalars: give as many values as references");
    for (size_t i = 0; i < count; i++)
        if (get(c, references[i], 0, &values[i]) != OK) return ERROR;
    return OK;
}

FMI fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference references[], size_t count, fmi3Int32 values[],
                            size_t sizes)
{
    if (count != sizes) return tell(c, ERROR, "all variables are scalars: give as many values as references");
    for (size_t i = 0; i < count; i++) {
        double value;
        if (get(c, references[i], 1, &value) != OK) return ERROR;
        values[i] = (int32_t)value;
    }
    return OK;
}

FMI fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                              const fmi3Float64 values[], size_t sizes)
{
    if (!may(c, "fmi3SetFloat64", IN(INSTANTIATED) | IN(INITIALIZING) | IN(STEPPING))) return ERROR;
    if (count != sizes) return tell(c, ERROR, "all variables are scalars: give as many values as references");
    for (size_t i = 0; i < count; i++)
        if (set(c, references[i], 0, values[i]) != OK) return ERROR;
    return OK;
}

FMI fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                            const fmi3Int32 values[], size_t sizes)
{
    if (!may(c, "fmi3SetInt32", IN(INSTANTIATED) | IN(INITIALIZING) | IN(STEPPING))) return ERROR;
    if (count != sizes) return tell(c, ERROR, "all variables are scalars: give as many values as references");
    for (size_t i = 0; i < count; i++)
        if (set(c, references[i], 1, values[i]) != OK) return ERROR;
    return OK;
}

/* --- states --- */

FMI fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) { return hand_out_state(c, state); }

FMI fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) { return restore(c, state, state_size()); }

FMI fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    (void)c;
    return free_state(state);
}

FMI fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    (void)c;
    (void)state;
    *size = state_size();
    return OK;
}

FMI fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    return serialize(c, state, bytes, size);
}

FMI fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    return deserialize(c, bytes, size, state);
}

/* --- what this unit has none of: the standard wants its functions to be there --- */

static int none(fmi3Instance c, size_t count)
{
    return count == 0 ? OK : tell(c, ERROR, "this unit has no variables of this type");
}

#define TYPE(name, type)                                                                                          \
    FMI fmi3Status fmi3Get##name(fmi3Instance c, const fmi3ValueReference references[], size_t count,             \
                                 type values[], size_t sizes)                                                     \
    {                                                                                                             \
        (void)references;                                                                                         \
        (void)values;                                                                                             \
        (void)sizes;                                                                                              \
        return none(c, count);                                                                                    \
    }                                                                                                             \
    FMI fmi3Status fmi3Set##name(fmi3Instance c, const fmi3ValueReference references[], size_t count,             \
                                 const type values[], size_t sizes)                                               \
    {                                                                                                             \
        (void)references;                                                                                         \
        (void)values;                                                                                             \
        (void)sizes;                                                                                              \
        return none(c, count);                                                                                    \
    }

TYPE(Float32, float)
TYPE(Int8, int8_t)
TYPE(UInt8, uint8_t)
TYPE(Int16, int16_t)
TYPE(UInt16, uint16_t)
TYPE(UInt32, uint32_t)
TYPE(Int64, int64_t)
TYPE(UInt64, uint64_t)
TYPE(Boolean, bool)
TYPE(String, fmi3String)

FMI fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference references[], size_t count, size_t valueSizes[],
                             const fmi3Byte *values[], size_t sizes)
{
    (void)references;
    (void)valueSizes;
    (void)values;
    (void)sizes;
    return none(c, count);
}

FMI fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference references[], size_t count,
                             const size_t valueSizes[], const fmi3Byte *const values[], size_t sizes)
{
    (void)references;
    (void)valueSizes;
    (void)values;
    (void)sizes;
    return none(c, count);
}

FMI fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference references[], size_t count, bool values[])
{
    (void)references;
    (void)values;
    return none(c, count);
}

FMI fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference references[], size_t count, const bool values[])
{
    (void)references;
    (void)values;
    return none(c, count);
}

/* Their further arguments are not looked at, which the calling conventions of C allow. */
#define ABSENT(name)                                                          \
    FMI fmi3Status fmi3##name(fmi3Instance c)                                 \
    {                                                                         \
        return tell(c, ERROR, "this unit does not offer fmi3" #name);         \
    }

ABSENT(GetNumberOfVariableDependencies)
ABSENT(GetVariableDependencies)
ABSENT(GetDirectionalDerivative)
ABSENT(GetAdjointDerivative)
ABSENT(EnterConfigurationMode)
ABSENT(ExitConfigurationMode)
ABSENT(EnterEventMode)
ABSENT(EnterStepMode)
ABSENT(GetIntervalDecimal)
ABSENT(GetIntervalFraction)
ABSENT(GetShiftDecimal)
ABSENT(GetShiftFraction)
ABSENT(SetIntervalDecimal)
ABSENT(SetIntervalFraction)
ABSENT(SetShiftDecimal)
ABSENT(SetShiftFraction)
ABSENT(EvaluateDiscreteStates)
ABSENT(UpdateDiscreteStates)
ABSENT(EnterContinuousTimeMode)
ABSENT(CompletedIntegratorStep)
ABSENT(SetTime)
ABSENT(SetContinuousStates)
ABSENT(GetContinuousStateDerivatives)
ABSENT(GetEventIndicators)
ABSENT(GetContinuousStates)
ABSENT(GetNominalsOfContinuousStates)
ABSENT(GetNumberOfEventIndicators)
ABSENT(GetNumberOfContinuousStates)
ABSENT(GetOutputDerivatives)
ABSENT(ActivateModelPartition)
