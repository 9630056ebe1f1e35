/* A host without Python: a full turn to the left, as fast as this computer can. Prints time [s], joint angle [rad] and the
 * pressure [bar] in port A ten times a second, then how long a step of 10 ms took.
 *
 *     aoro-gym export twin --format c --out build/aoro
 *     cc host.c -Ibuild/aoro -Lbuild/aoro -laoro -Wl,-rpath,'$ORIGIN/aoro' -o build/host && build/host */

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include <aoro.h>

static double seconds(void)
{
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

static void check(aoro *twin, aoro_status status)
{
    if (status == AORO_OK) return;
    fprintf(stderr, "error: %s\n", aoro_message(twin));
    aoro_free(twin);
    exit(1);
}

int main(void)
{
    aoro *twin = aoro_new();
    if (twin == NULL) return 1;
    check(twin, aoro_set(twin, AORO_INITIAL_JOINT_ANGLE, -0.6)); /* to the right */
    check(twin, aoro_reset(twin));
    check(twin, aoro_set(twin, AORO_STEERING_SIGNAL, 1.0)); /* full signal to the left */

    const double began = seconds();
    for (int step = 1; step <= 300; step++) {
        check(twin, aoro_advance(twin, 10));
        if (step % 10 == 0)
            printf("%.1f %.9g %.9g\n", aoro_get(twin, AORO_TIME), aoro_get(twin, AORO_JOINT_ANGLE),
                   aoro_get(twin, AORO_PRESSURE_A) / 1e5);
    }
    fprintf(stderr, "%.1f us a step of 10 ms\n", 1e6 * (seconds() - began) / 300);
    aoro_free(twin);
    return 0;
}
