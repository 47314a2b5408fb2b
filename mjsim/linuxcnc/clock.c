/* Preloaded into LinuxCNC's programs: their monotonic clock runs MJSIM_CLOCK times as fast. For simulation only.
   The servo thread then does its cycles in a fraction of the time; each cycle computes the same. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <time.h>

#define SECOND 1000000000LL

static double factor = 1.0;
static long long begin;
static int (*true_gettime)(clockid_t, struct timespec *);
static int (*true_nanosleep)(clockid_t, int, const struct timespec *, struct timespec *);

static long long count(const struct timespec *t) { return t->tv_sec * SECOND + t->tv_nsec; }

static struct timespec spread(long long nanoseconds)
{
    struct timespec t = {nanoseconds / SECOND, nanoseconds % SECOND};
    return t;
}

__attribute__((constructor)) static void prepare(void)
{
    struct timespec now;
    const char *given = getenv("MJSIM_CLOCK");
    true_gettime = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    true_nanosleep =
        (int (*)(clockid_t, int, const struct timespec *, struct timespec *))dlsym(RTLD_NEXT, "clock_nanosleep");
    if (given && atof(given) > 0.0) factor = atof(given);
    true_gettime(CLOCK_MONOTONIC, &now);
    begin = count(&now);
}

int clock_gettime(clockid_t clock, struct timespec *t)
{
    int result = true_gettime(clock, t);
    if (result == 0 && clock == CLOCK_MONOTONIC) *t = spread(begin + (long long)(factor * (count(t) - begin)));
    return result;
}

int clock_nanosleep(clockid_t clock, int flags, const struct timespec *until, struct timespec *left)
{
    struct timespec t = *until;
    if (clock == CLOCK_MONOTONIC && (flags & TIMER_ABSTIME))
        t = spread(begin + (long long)((count(until) - begin) / factor));
    return true_nanosleep(clock, flags, &t, left);
}
