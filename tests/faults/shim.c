/* Make calls of libc fail that write below a folder, for `tests/faults`.

   fault_arm(root, mode, at, log) arms it in a process that has it preloaded. Calls that write to
   files below `root`, or rename to or make folders there, are counted from 1. Modes:

     count    write the name of each call to the file `log`
     enospc   the disk is full from call `at` on; a rename fails only if it is this call
     once     only this call fails, with EIO
     lost     from call `at` on, fwrite says yes and loses the data, which only fflush, fclose and
              fsync report; all other calls fail as in enospc
     kill     SIGKILL before this call
     stop     SIGINT before this call

   stdio of libc calls a hidden write, so that fwrite, fflush and fclose are replaced too. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static char root[PATH_MAX], mode;
static int at, seen, log_handle = -1;

#define REAL(result, name, args)              \
    static result(*real) args;                \
    if (!real) real = (result(*) args)dlsym(RTLD_NEXT, #name)

static ssize_t plain_write(int fd, const void *data, size_t size) {
    REAL(ssize_t, write, (int, const void *, size_t));
    return real(fd, data, size);
}

void fault_arm(const char *folder, const char *what, int number, const char *log) {
    snprintf(root, sizeof root, "%s", folder);
    at = number;
    log_handle = log && *log ? open(log, O_WRONLY | O_CREAT | O_APPEND, 0666) : -1;
    mode = *what;
}

static int is_below(const char *path) {
    return !strncmp(path, root, strlen(root));
}

static int is_ours(int fd) {
    char link[64], path[PATH_MAX];
    if (!mode || fd < 0) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t size = readlink(link, path, sizeof path - 1);
    if (size < 0) return 0;
    path[size] = 0;
    return is_below(path);
}

static int fails(const char *name, int is_rename) {
    int number = __sync_add_and_fetch(&seen, 1);
    if (mode == 'c' && log_handle >= 0) {
        char line[64];
        plain_write(log_handle, line, snprintf(line, sizeof line, "%s\n", name));
    }
    if (mode == 'k' && number == at) kill(getpid(), SIGKILL);
    if (mode == 's' && number == at) kill(getpid(), SIGINT);
    errno = mode == 'o' ? EIO : ENOSPC;
    if (mode == 'o') return number == at;
    if (mode == 'e' || mode == 'l') return is_rename ? number == at : number >= at;
    return 0;
}

#define WRITES(result, name, params, args)    \
    result name params {                      \
        REAL(result, name, params);           \
        if (is_ours(fd) && fails(#name, 0)) return -1; \
        return real args;                     \
    }
WRITES(ssize_t, write, (int fd, const void *data, size_t size), (fd, data, size))
WRITES(ssize_t, pwrite, (int fd, const void *data, size_t size, off_t to), (fd, data, size, to))
WRITES(ssize_t, pwrite64, (int fd, const void *data, size_t size, off64_t to), (fd, data, size, to))
WRITES(ssize_t, writev, (int fd, const struct iovec *data, int count), (fd, data, count))
WRITES(int, ftruncate, (int fd, off_t size), (fd, size))
WRITES(int, ftruncate64, (int fd, off64_t size), (fd, size))
WRITES(int, fsync, (int fd), (fd))

static FILE *lost[256];
static int lost_count;

static int is_lost(FILE *file) {
    for (int i = 0; i < lost_count; i++)
        if (lost[i] == file) return 1;
    return 0;
}

size_t fwrite(const void *data, size_t size, size_t count, FILE *file) {
    REAL(size_t, fwrite, (const void *, size_t, size_t, FILE *));
    if (mode && is_ours(fileno(file)) && fails("fwrite", 0)) {
        if (mode != 'l') return 0;
        if (!is_lost(file) && lost_count < 256) lost[lost_count++] = file;
        return count;
    }
    return real(data, size, count, file);
}

int fflush(FILE *file) {
    REAL(int, fflush, (FILE *));
    if (mode && file && is_lost(file)) {
        errno = ENOSPC;
        return EOF;
    }
    if (mode && file && is_ours(fileno(file)) && fails("fflush", 0)) return EOF;
    return real(file);
}

int fclose(FILE *file) {
    REAL(int, fclose, (FILE *));
    int is_bad = mode && file && is_lost(file);
    for (int i = 0; i < lost_count; i++)
        if (lost[i] == file) lost[i] = NULL;
    if (mode && file && !is_bad && is_ours(fileno(file))) is_bad = fails("fclose", 0);
    int result = real(file);
    if (!is_bad) return result;
    errno = ENOSPC;
    return EOF;
}

int rename(const char *from, const char *to) {
    REAL(int, rename, (const char *, const char *));
    if (mode && is_below(to) && fails("rename", 1)) return -1;
    return real(from, to);
}

int mkdir(const char *path, mode_t bits) {
    REAL(int, mkdir, (const char *, mode_t));
    if (mode && is_below(path) && fails("mkdir", 0)) return -1;
    return real(path, bits);
}
