/* Preloaded into a process: counts the operations that change a folder and, at one of them, kills it or fails.

   The operations are those of the C library: writes, truncations, syncs, and the creation, renaming and removal
   of names. Each that is done is appended to a log as a line of text and, for a write, its bytes; see log.py.
   The process is killed before the operation ('k'); or the operation fails with EIO, alone ('e') or with all later
   ones ('E'); or there is no room from its middle on, and all that need room fail with ENOSPC ('S'). */

#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

enum verdict { WHOLE, HALF, FAILS };

static pthread_mutex_t turn = PTHREAD_MUTEX_INITIALIZER;
static char folder[PATH_MAX], action;
static int log_file = -1;
static long point, count;

void faults_end(void) { folder[0] = 0; }

void faults_begin(const char *where, int log, char what, long at)
{
    log_file = log, action = what, point = at, count = 0;
    snprintf(folder, sizeof folder, "%s", where);
}

__attribute__((constructor)) static void from_environment(void)
{
    const char *where = getenv("FAULTS_FOLDER"), *log = getenv("FAULTS_LOG");
    if (where && log)
        faults_begin(where, open(log, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600), *getenv("FAULTS_ACTION"),
                     atol(getenv("FAULTS_POINT")));
}

static void die(void)
{
    kill(getpid(), SIGKILL);
    pause();
}

/* Take a turn, count an operation and say what becomes of it; the process may end here. */
static enum verdict begin(int needs_room)
{
    pthread_mutex_lock(&turn);
    long now = ++count;
    if (now == point && action == 'k') die();
    errno = action == 'S' ? ENOSPC : EIO;
    if (now == point && action != '-') return action == 'S' ? HALF : FAILS;
    return now > point && (action == 'E' || (action == 'S' && needs_room)) ? FAILS : WHOLE;
}

/* End the turn of an operation that was done, wholly or in part, and log it unless it failed. */
static long end(enum verdict verdict, long result, const char *kind, unsigned long inode, long offset, long size,
                const char *path, const char *other, const void *data)
{
    int failure = errno;
    if (result >= 0 && verdict != FAILS) {
        dprintf(log_file, "%s\t%lu\t%ld\t%ld\t%s\t%s\n", kind, inode, offset, size, path, other);
        if (data) syscall(SYS_write, log_file, data, (size_t)size);
    }
    pthread_mutex_unlock(&turn);
    errno = failure;
    return verdict == FAILS ? -1 : result;
}

/* A change that cannot be half done. */
static enum verdict begin_whole(int needs_room)
{
    return begin(needs_room) == WHOLE ? WHOLE : FAILS;
}

static int inside(const char *path)
{
    size_t length = strlen(folder);
    return length && !strncmp(path, folder, length) && (path[length] == '/' || !path[length]);
}

static int inside_file(int file, char *path)
{
    char link[64];
    int failure = errno;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = folder[0] ? readlink(link, path, PATH_MAX - 1) : -1;
    path[length > 0 ? length : 0] = 0;
    errno = failure;
    return inside(path);
}

static int inside_at(int directory, const char *name, char *path)
{
    char start[PATH_MAX] = "";
    if (!folder[0]) return 0;
    if (name[0] != '/' && directory == AT_FDCWD && !getcwd(start, sizeof start)) return 0;
    if (name[0] != '/' && directory != AT_FDCWD) inside_file(directory, start);
    return snprintf(path, PATH_MAX, "%s%s%s", start, name[0] == '/' ? "" : "/", name) < PATH_MAX && inside(path);
}

static ssize_t put(int file, const void *data, size_t size, off_t at)
{
    char path[PATH_MAX];
    struct stat status;
    int counts = inside_file(file, path) && !fstat(file, &status);
    enum verdict verdict = WHOLE;
    off_t start = at;
    if (counts && at < 0)
        start = fcntl(file, F_GETFL) & O_APPEND ? status.st_size : lseek(file, 0, SEEK_CUR);
    if (counts) verdict = begin(start + (off_t)size > status.st_size);
    if (verdict == HALF && (size /= 2) == 0) verdict = FAILS;
    ssize_t done = -1;
    if (verdict != FAILS)
        done = at < 0 ? syscall(SYS_write, file, data, size) : syscall(SYS_pwrite64, file, data, size, at);
    return counts ? end(verdict, done, "write", status.st_ino, start, done, path, "", data) : done;
}

ssize_t write(int file, const void *data, size_t size) { return put(file, data, size, -1); }
ssize_t pwrite(int file, const void *data, size_t size, off_t at) { return put(file, data, size, at); }
ssize_t pwrite64(int, const void *, size_t, off64_t) __attribute__((alias("pwrite")));

ssize_t pwritev(int file, const struct iovec *parts, int number, off_t at)
{
    char path[PATH_MAX];
    if (!inside_file(file, path))
        return at < 0 ? syscall(SYS_writev, file, parts, number) : syscall(SYS_pwritev, file, parts, number, at, 0L);
    /* A call may write less than it is asked to: here the first part that has any bytes. */
    while (number > 1 && !parts->iov_len) parts++, number--;
    return number ? put(file, parts->iov_base, parts->iov_len, at) : 0;
}
ssize_t pwritev64(int, const struct iovec *, int, off64_t) __attribute__((alias("pwritev")));
ssize_t writev(int file, const struct iovec *parts, int number) { return pwritev(file, parts, number, -1); }

/* Copies within the kernel: the caller copies by writes instead, as where a file system has no such thing. */
ssize_t sendfile(int to, int from, off_t *at, size_t size)
{
    char path[PATH_MAX];
    if (!inside_file(to, path)) return syscall(SYS_sendfile, to, from, at, size);
    errno = ENOTSOCK;
    return -1;
}
ssize_t sendfile64(int, int, off64_t *, size_t) __attribute__((alias("sendfile")));

int ftruncate(int file, off_t size)
{
    char path[PATH_MAX];
    struct stat status;
    if (!inside_file(file, path) || fstat(file, &status)) return syscall(SYS_ftruncate, file, size);
    enum verdict verdict = begin_whole(0);
    int done = verdict == FAILS ? -1 : syscall(SYS_ftruncate, file, size);
    return end(verdict, done, "truncate", status.st_ino, 0, size, path, "", NULL);
}
int ftruncate64(int, off64_t) __attribute__((alias("ftruncate")));

int truncate(const char *path, off_t size)
{
    int file = open(path, O_WRONLY | O_CLOEXEC);
    int done = file < 0 ? -1 : ftruncate(file, size), failure = errno;
    if (file >= 0) close(file);
    errno = failure;
    return done;
}
int truncate64(const char *, off64_t) __attribute__((alias("truncate")));

int posix_fallocate(int file, off_t start, off_t size)
{
    char path[PATH_MAX];
    struct stat status;
    int failure = errno, counts = inside_file(file, path) && !fstat(file, &status);
    enum verdict verdict = counts ? begin_whole(1) : WHOLE;
    int done = verdict == FAILS ? -1 : syscall(SYS_fallocate, file, 0, start, size);
    if (counts) done = end(verdict, done, "allocate", status.st_ino, 0, start + size, path, "", NULL);
    int answer = done ? errno : 0;
    errno = failure;
    return answer;
}
int posix_fallocate64(int, off64_t, off64_t) __attribute__((alias("posix_fallocate")));

/* A killed process loses nothing that the system has, so that nothing need be synced here. */
int fsync(int file)
{
    char path[PATH_MAX];
    struct stat status;
    if (!inside_file(file, path) || fstat(file, &status)) return syscall(SYS_fsync, file);
    enum verdict verdict = begin_whole(0);
    return end(verdict, 0, S_ISDIR(status.st_mode) ? "sync folder" : "sync", status.st_ino, 0, 0, path, "", NULL);
}
int fdatasync(int) __attribute__((alias("fsync")));

int openat(int directory, const char *name, int flags, ...)
{
    char path[PATH_MAX];
    struct stat status;
    va_list rest;
    va_start(rest, flags);
    int unnamed = (flags & O_TMPFILE) == O_TMPFILE;
    mode_t mode = flags & O_CREAT || unnamed ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    int creates = flags & O_CREAT || unnamed, empties = flags & O_TRUNC;
    if (!(creates || empties) || !inside_at(directory, name, path))
        return syscall(SYS_openat, directory, name, flags, mode);
    creates = unnamed || lstat(path, &status);
    if (!creates && !(empties && status.st_size)) return syscall(SYS_openat, directory, name, flags, mode);
    enum verdict verdict = begin_whole(creates);
    int file = verdict == FAILS ? -1 : syscall(SYS_openat, directory, name, flags, mode);
    if (file >= 0) fstat(file, &status);
    return end(verdict, file, creates ? "create" : "truncate", status.st_ino, 0, 0, unnamed ? "" : path, "", NULL);
}
int openat64(int, const char *, int, ...) __attribute__((alias("openat")));

int open(const char *name, int flags, ...)
{
    va_list rest;
    va_start(rest, flags);
    mode_t mode = flags & O_CREAT || (flags & O_TMPFILE) == O_TMPFILE ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    return openat(AT_FDCWD, name, flags, mode);
}
int open64(const char *, int, ...) __attribute__((alias("open")));

int mkdirat(int directory, const char *name, mode_t mode)
{
    char path[PATH_MAX];
    struct stat status;
    if (!inside_at(directory, name, path) || !lstat(path, &status)) return syscall(SYS_mkdirat, directory, name, mode);
    enum verdict verdict = begin_whole(1);
    int done = verdict == FAILS ? -1 : syscall(SYS_mkdirat, directory, name, mode);
    return end(verdict, done, "make folder", 0, 0, 0, path, "", NULL);
}
int mkdir(const char *name, mode_t mode) { return mkdirat(AT_FDCWD, name, mode); }

int unlinkat(int directory, const char *name, int flags)
{
    char path[PATH_MAX];
    struct stat status;
    if (!inside_at(directory, name, path) || lstat(path, &status)) return syscall(SYS_unlinkat, directory, name, flags);
    enum verdict verdict = begin_whole(0);
    int done = verdict == FAILS ? -1 : syscall(SYS_unlinkat, directory, name, flags);
    return end(verdict, done, "remove", 0, 0, 0, path, "", NULL);
}
int unlink(const char *name) { return unlinkat(AT_FDCWD, name, 0); }
int rmdir(const char *name) { return unlinkat(AT_FDCWD, name, AT_REMOVEDIR); }

int renameat2(int directory, const char *name, int other_directory, const char *other_name, unsigned flags)
{
    char path[PATH_MAX], other[PATH_MAX];
    int counts = inside_at(directory, name, path) | inside_at(other_directory, other_name, other);
    enum verdict verdict = counts ? begin_whole(0) : WHOLE;
    int done = verdict == FAILS ? -1 : syscall(SYS_renameat2, directory, name, other_directory, other_name, flags);
    return counts ? end(verdict, done, "rename", 0, 0, 0, path, other, NULL) : done;
}
int renameat(int directory, const char *name, int other_directory, const char *other_name)
{
    return renameat2(directory, name, other_directory, other_name, 0);
}
int rename(const char *name, const char *other) { return renameat2(AT_FDCWD, name, AT_FDCWD, other, 0); }
