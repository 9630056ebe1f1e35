/* An hour of simulated work, turn after turn on the spot and under way, in steps of 1 ms: how long a step takes, and whether
 * memory grows. Built as host.c is; takes about half a minute. */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <aoro.h>

enum { SECONDS = 3600, STEPS = 1000 * SECONDS };

static double microseconds(void)
{
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return 1e6 * now.tv_sec + 1e-3 * now.tv_nsec;
}

/* Memory [kB] of this process that lies in the computer's. */
static long resident(void)
{
    char line[200];
    long size = -1;
    FILE *file = fopen("/proc/self/status", "r");
    while (file != NULL && fgets(line, sizeof line, file) != NULL)
        if (strncmp(line, "VmRSS:", 6) == 0) size = strtol(line + 6, NULL, 10);
    if (file != NULL) fclose(file);
    return size;
}

static int by_size(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

int main(void)
{
    float *took = malloc(STEPS * sizeof *took);
    aoro *twin = aoro_new();
    if (twin == NULL || took == NULL || aoro_reset(twin) != AORO_OK) return 1;
    memset(took, 0, STEPS * sizeof *took); /* so that it lies in memory from the start */
    long start = resident(); /* asked once before it counts, so that asking costs nothing afterwards */
    for (int step = 0; step < STEPS; step++) {
        if (step % 4000 == 0) {
            aoro_set(twin, AORO_STEERING_SIGNAL, step % 8000 == 0 ? 1.0 : -1.0);
            aoro_set(twin, AORO_DRIVE_SIGNAL, step / 16000 % 2 == 0 ? 0.0 : 0.3);
            aoro_set(twin, AORO_GEAR, 1 + step / 32000 % 3);
        }
        const double began = microseconds();
        const aoro_status done = aoro_advance(twin, 1);
        took[step] = (float)(microseconds() - began);
        if (done != AORO_OK) {
            fprintf(stderr, "error: %s\n", aoro_message(twin));
            return 1;
        }
        if (step == 10000) start = resident();
    }
    const long end = resident();
    qsort(took, STEPS, sizeof *took, by_size);
    printf("{\"seconds\": %d, \"median_us\": %.2f, \"p99_us\": %.2f, \"largest_us\": %.0f,"
           " \"rss_start_kB\": %ld, \"rss_end_kB\": %ld}\n",
           SECONDS, took[STEPS / 2], took[STEPS / 100 * 99], took[STEPS - 1], start, end);
    aoro_free(twin);
    free(took);
    return 0;
}
