/* The wire of the firmware as a Linux process: a pseudo terminal or a serial device. pty.h describes the functions. */

#define _XOPEN_SOURCE 700
#define _DEFAULT_SOURCE /* flock, cfmakeraw, FIONREAD */

#include "pty.h"

#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#define UNREAD_LIMIT 2048 /* bytes: as on a UART, unread bytes are lost */

static bool fail(Pty *pty, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(pty->problem, sizeof pty->problem, format, arguments);
    va_end(arguments);
    return false;
}

static bool fail_to_create(Pty *pty)
{
    return fail(pty, "%s: cannot be made: %s; choose another device path", pty->link_path, strerror(errno));
}

static bool set_raw(int fd)
{
    struct termios settings;
    if (tcgetattr(fd, &settings) != 0)
        return false;
    cfmakeraw(&settings);
    return tcsetattr(fd, TCSANOW, &settings) == 0;
}

static bool open_terminal(Pty *pty)
{
    pty->master_fd = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (pty->master_fd < 0 || grantpt(pty->master_fd) != 0 || unlockpt(pty->master_fd) != 0)
        return false;
    const char *path = ptsname(pty->master_fd);
    if (path == NULL || strlen(path) >= sizeof pty->slave_path)
        return false;
    strcpy(pty->slave_path, path);
    pty->slave_fd = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
    return pty->slave_fd >= 0 && set_raw(pty->slave_fd) && fcntl(pty->master_fd, F_SETFL, O_NONBLOCK) == 0;
}

static bool is_same_file(int fd, const char *path)
{
    struct stat ours, found;
    return fstat(fd, &ours) == 0 && stat(path, &found) == 0 && ours.st_dev == found.st_dev
        && ours.st_ino == found.st_ino;
}

static bool acquire_lock(Pty *pty)
{
    for (;;) {
        pty->lock_fd = open(pty->lock_path, O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0644);
        if (pty->lock_fd < 0)
            return fail_to_create(pty);
        if (flock(pty->lock_fd, LOCK_EX | LOCK_NB) != 0)
            return fail(pty, "%s: already served by another process; end that one or choose another device path",
                        pty->link_path);
        if (is_same_file(pty->lock_fd, pty->lock_path))
            return true;
        close(pty->lock_fd); /* its owner removed the file between our open and our lock, so the lock has no effect */
    }
}

static bool is_link_to(const char *path, const char *beginning)
{
    char target[256] = "";
    return readlink(path, target, sizeof target - 1) > 0 && strncmp(target, beginning, strlen(beginning)) == 0;
}

static bool create_link(Pty *pty)
{
    char new_path[PTY_PATH_SIZE + 8];
    struct stat found;
    snprintf(new_path, sizeof new_path, "%s.new", pty->link_path);
    if (lstat(pty->link_path, &found) == 0 && !is_link_to(pty->link_path, "/dev/pts/"))
        return fail(pty, "%s: exists and is not a link to a pty; remove it or choose another device path",
                    pty->link_path);
    if (lstat(new_path, &found) == 0 && S_ISLNK(found.st_mode))
        unlink(new_path); /* left by a run that was killed at this point */
    if (symlink(pty->slave_path, new_path) != 0 || rename(new_path, pty->link_path) != 0)
        return fail_to_create(pty);
    return true;
}

bool pty_open(Pty *pty, const char *link_path)
{
    *pty = (Pty){.master_fd = -1, .slave_fd = -1, .lock_fd = -1};
    if (strlen(link_path) >= sizeof pty->link_path)
        return fail(pty, "the device path is too long; choose another one");
    strcpy(pty->link_path, link_path);
    snprintf(pty->lock_path, sizeof pty->lock_path, "%s.lock", link_path);
    bool opened = open_terminal(pty)
        || fail(pty, "pty: %s; raise kernel.pty.max or close other terminals", strerror(errno));
    if (opened && acquire_lock(pty) && create_link(pty))
        return true;
    pty_close(pty);
    return false;
}

size_t pty_read(Pty *pty, uint8_t *out, size_t capacity)
{
    ssize_t count = read(pty->master_fd, out, capacity);
    return count > 0 ? (size_t)count : 0;
}

void pty_write(Pty *pty, const uint8_t *data, size_t size)
{
    int unread = 0;
    if (ioctl(pty->slave_fd, FIONREAD, &unread) == 0 && unread >= UNREAD_LIMIT)
        return;
    ssize_t written = write(pty->master_fd, data, size);
    (void)written; /* a full line loses bytes, as a UART does */
}

static void close_if_open(int *fd)
{
    if (*fd >= 0)
        close(*fd);
    *fd = -1;
}

void pty_close(Pty *pty)
{
    if (pty->lock_fd >= 0 && is_same_file(pty->lock_fd, pty->lock_path)) {
        if (is_link_to(pty->link_path, pty->slave_path))
            unlink(pty->link_path);
        unlink(pty->lock_path); /* before the lock is released: no process can then lock a file that is being removed */
    }
    close_if_open(&pty->lock_fd);
    close_if_open(&pty->slave_fd);
    close_if_open(&pty->master_fd);
}
