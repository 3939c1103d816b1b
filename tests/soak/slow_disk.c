/* A disk that is slow while the file that SEMMAP_SLOW names is there. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdlib.h>
#include <sys/types.h>
#include <time.h>
#include <unistd.h>

static void wait_for_disk(long milliseconds, int one_of)
{
    const char *file = getenv("SEMMAP_SLOW");
    int before = errno;
    if (file && access(file, F_OK) == 0) {
        struct timespec now, left;
        clock_gettime(CLOCK_MONOTONIC, &now);
        if (one_of && (now.tv_nsec / 1000) % one_of == 0)
            milliseconds = 5000;
        left.tv_sec = milliseconds / 1000;
        left.tv_nsec = milliseconds % 1000 * 1000000;
        while (nanosleep(&left, &left) && errno == EINTR)
            ;
    }
    errno = before;
}

#define SLOW(result, name, parameters, arguments, milliseconds, one_of)                            \
    result name parameters                                                                         \
    {                                                                                              \
        static result (*real) parameters;                                                          \
        if (!real)                                                                                 \
            *(void **)&real = dlsym(RTLD_NEXT, #name);                                             \
        wait_for_disk(milliseconds, one_of);                                                       \
        return real arguments;                                                                     \
    }

SLOW(int, fsync, (int fd), (fd), 200, 40)
SLOW(int, fdatasync, (int fd), (fd), 200, 40)
SLOW(ssize_t, pwrite, (int fd, const void *from, size_t size, off_t at), (fd, from, size, at), 2, 0)
SLOW(ssize_t, pwrite64, (int fd, const void *from, size_t size, off64_t at), (fd, from, size, at), 2, 0)
