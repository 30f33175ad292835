/* Preloaded before the C library: a file system without locks, and a clock that is set while a program runs.
   UNVEIL_FLOCK_ERROR: number of the error that every flock fails with. UNVEIL_CLOCK_STEP: seconds by which the time of day
   jumps back and forth, every half second. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdlib.h>
#include <sys/time.h>
#include <time.h>

int flock(int handle, int operation) {
    const char *error = getenv("UNVEIL_FLOCK_ERROR");
    if (error) {
        errno = atoi(error);
        return -1;
    }
    static int (*real)(int, int);
    if (!real) real = (int (*)(int, int))dlsym(RTLD_NEXT, "flock");
    return real(handle, operation);
}

int clock_gettime(clockid_t which, struct timespec *now) {
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int result = real(which, now);
    const char *step = getenv("UNVEIL_CLOCK_STEP");
    if (!result && step && which == CLOCK_REALTIME && now->tv_nsec / 500000000 == 1) now->tv_sec += atol(step);
    return result;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone) {
    struct timespec found;
    int result = clock_gettime(CLOCK_REALTIME, &found);
    (void)zone;
    now->tv_sec = found.tv_sec;
    now->tv_usec = found.tv_nsec / 1000;
    return result;
}

time_t time(time_t *where) {
    struct timespec found;
    clock_gettime(CLOCK_REALTIME, &found);
    if (where) *where = found.tv_sec;
    return found.tv_sec;
}
