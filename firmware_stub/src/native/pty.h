/* A pseudo terminal with a fixed name, as PtyWire of hil/links/wires/terminal.py. */
#ifndef UUV_HIL_NATIVE_PTY_H
#define UUV_HIL_NATIVE_PTY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define PTY_PATH_SIZE 4096

typedef struct {
    int master_fd;
    int slave_fd; /* stays open, so that programs can open and close the other end without a hang-up */
    int lock_fd;
    char link_path[PTY_PATH_SIZE]; /* a symbolic link to slave_path */
    char lock_path[PTY_PATH_SIZE + 8];
    char slave_path[256];
    char problem[PTY_PATH_SIZE + 256]; /* why opening failed, as text for the user */
} Pty;

/* Returns whether it succeeded; otherwise `problem` has the reason. Only one process at a time can use the name. */
bool pty_open(Pty *pty, const char *link_path);

/* Read the received bytes. Returns their number, 0 if none. */
size_t pty_read(Pty *pty, uint8_t *out, size_t capacity);

/* Write all of data or, if the other end has stopped reading, nothing. */
void pty_write(Pty *pty, const uint8_t *data, size_t size);

void pty_close(Pty *pty);

#endif
