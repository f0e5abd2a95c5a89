/* A disk that fails: while the file HMD_FAIL_WHILE exists, syncs of files below HMD_FAIL_FOLDER end with EIO, and with
 * HMD_FAIL_ALL set whatever else would change one as well. To be loaded before the C library (LD_PRELOAD). */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

/* The function of this name that the program would have called without us. */
#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

static int fails(const char *path, int is_sync)
{
    const char *folder = getenv("HMD_FAIL_FOLDER"), *flag = getenv("HMD_FAIL_WHILE");
    if (!folder || !flag || strncmp(path, folder, strlen(folder)) != 0)
        return 0;
    if (!is_sync && !getenv("HMD_FAIL_ALL"))
        return 0;
    int before = errno, failing = access(flag, F_OK) == 0;
    errno = failing ? EIO : before;
    return failing;
}

static int file_fails(int file, int is_sync)
{
    char link[32], path[PATH_MAX];
    int before = errno;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, path, sizeof path - 1);
    errno = before;
    if (length < 0)
        return 0;
    path[length] = 0;
    return fails(path, is_sync);
}

ssize_t write(int file, const void *bytes, size_t count)
{
    return file_fails(file, 0) ? -1 : NEXT(write)(file, bytes, count);
}

int fsync(int file)
{
    return file_fails(file, 1) ? -1 : NEXT(fsync)(file);
}

int fdatasync(int file)
{
    return file_fails(file, 1) ? -1 : NEXT(fdatasync)(file);
}

int open64(const char *path, int flags, ...)
{
    va_list rest;
    va_start(rest, flags);
    mode_t mode = flags & O_CREAT ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    return (flags & O_CREAT) && fails(path, 0) ? -1 : NEXT(open64)(path, flags, mode);
}

int rename(const char *from, const char *to)
{
    return fails(from, 0) ? -1 : NEXT(rename)(from, to);
}

int unlink(const char *path)
{
    return fails(path, 0) ? -1 : NEXT(unlink)(path);
}
