/* The firmware as a Linux process, uuv-hil-stm32-native PTY CHANNELS WATCHDOG_US: firmware_stub.native starts it, with the
 * master of the pseudo terminal PTY as its standard input. POSIX, except for die_with_parent. */

#define _GNU_SOURCE /* F_SETSIG */

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <sys/select.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "uuv_hil_stm32.h"

#define NAME "uuv-hil-stm32-native"
#define UNREAD_LIMIT 2048 /* bytes: as on a UART, unread bytes are lost */

enum { MASTER = STDIN_FILENO, BAD_OPTION = 2, BAD_DEVICE = 3 };

static volatile sig_atomic_t stop_requested;

static void on_signal(int number)
{
    (void)number;
    stop_requested = 1;
}

/* End this process when its parent ends or is killed, as hil/common/lifeline.py does. */
static void die_with_parent(void)
{
    const char *text = getenv("UUV_HIL_LIFELINE");
    int lifeline;
    unsigned long long inode;
    struct stat pipe;
    char byte;
    if (text == NULL || sscanf(text, "%d:%llu", &lifeline, &inode) != 2)
        return;
    if (fstat(lifeline, &pipe) != 0 || pipe.st_ino != inode)
        return; /* an intermediate process has closed it */
    fcntl(lifeline, F_SETOWN, getpgrp() == getpid() ? -getpid() : getpid());
    fcntl(lifeline, F_SETSIG, SIGKILL);
    fcntl(lifeline, F_SETFL, fcntl(lifeline, F_GETFL) | O_ASYNC | O_NONBLOCK);
    if (read(lifeline, &byte, 1) == 0) /* the parent ended before this request */
        raise(SIGKILL);
}

static uint64_t now_us(void *context)
{
    (void)context;
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;
}

static void uart_write(void *context, const uint8_t *data, size_t size)
{
    int unread = 0;
    if (ioctl(*(int *)context, FIONREAD, &unread) == 0 && unread >= UNREAD_LIMIT)
        return;
    ssize_t written = write(MASTER, data, size);
    (void)written; /* a full line loses bytes, as a UART does */
}

static void can_write(void *context, const UuvHilCanFrame *frame)
{
    (void)context; /* there is no CAN bus here */
    (void)frame;
}

static void pwm_set(void *context, const uint16_t *pulse_us, uint8_t channels)
{
    (void)context; /* a process has no pins: the telemetry reports the pulses */
    (void)pulse_us;
    (void)channels;
}

static void watchdog_kick(void *context)
{
    (void)context;
}

/* Signals are delivered only inside the wait, so that none is missed. */
static sigset_t catch_signals(void)
{
    sigset_t blocked, before;
    struct sigaction action = {.sa_handler = on_signal};
    sigemptyset(&blocked);
    sigaddset(&blocked, SIGINT);
    sigaddset(&blocked, SIGTERM);
    sigprocmask(SIG_BLOCK, &blocked, &before);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    signal(SIGPIPE, SIG_IGN);
    return before;
}

static void wait_until(uint64_t deadline_us, const sigset_t *mask)
{
    uint64_t now = now_us(NULL);
    uint64_t left_us = deadline_us > now ? deadline_us - now : 0;
    struct timespec timeout = {.tv_sec = (time_t)(left_us / 1000000u), .tv_nsec = (long)(left_us % 1000000u) * 1000};
    fd_set readable;
    FD_ZERO(&readable);
    FD_SET(MASTER, &readable);
    pselect(MASTER + 1, &readable, NULL, NULL, &timeout, mask);
}

/* After a pause longer than the watchdog's time, discard the bytes received meanwhile, as a UART does. The time is taken
 * after the read: a pause between the two would hide how old the bytes are. */
static size_t read_recent(uint8_t *bytes, size_t size, uint64_t *read_us, uint32_t limit_us)
{
    ssize_t count = read(MASTER, bytes, size);
    uint64_t now = now_us(NULL);
    bool was_stopped = now - *read_us > limit_us;
    for (int reads = 0; was_stopped && count > 0 && reads < 256; reads++)
        count = read(MASTER, bytes, size);
    *read_us = now;
    return was_stopped || count < 0 ? 0 : (size_t)count;
}

static void serve(UuvHilFirmware *firmware, const sigset_t *mask)
{
    uint64_t read_us = now_us(NULL);
    while (!stop_requested) {
        uint8_t bytes[4096];
        size_t count = read_recent(bytes, sizeof bytes, &read_us, firmware->board.watchdog_us);
        uuv_hil_service(firmware, bytes, count);
        wait_until(uuv_hil_deadline_us(firmware), mask);
    }
    uuv_hil_stop(firmware);
}

static void print_summary(const UuvHilFirmware *firmware)
{
    const UuvHilBoard *board = &firmware->board;
    printf("stopped: %u commands, %u refused, %u checksum errors, %u malformed, %u bytes dropped, ", board->frames,
           board->refused, firmware->frames.checksum_errors, firmware->malformed, firmware->frames.dropped_bytes);
    printf("%u watchdog trips; %s, pwm", board->watchdog_trips, board->timed_out ? "timed out" : "disarmed");
    for (uint8_t i = 0; i < board->channels; i++)
        printf(" %u", board->pwm_us[i]);
    printf("\n");
}

int main(int argc, char **argv)
{
    static UuvHilFirmware firmware;
    die_with_parent();
    unsigned long channels = argc == 4 ? strtoul(argv[2], NULL, 10) : 0;
    if (channels < 1 || channels > UUV_HIL_MAX_CHANNELS) {
        fprintf(stderr, NAME ": PTY CHANNELS WATCHDOG_US, with 1 to %u channels\n", UUV_HIL_MAX_CHANNELS);
        return BAD_OPTION;
    }
    int slave = open(argv[1], O_RDWR | O_NOCTTY | O_CLOEXEC); /* kept open, or the master hangs up with the last host */
    if (slave < 0) {
        perror(argv[1]);
        return BAD_DEVICE;
    }
    const UuvHilPlatform platform = {
        .context = &slave,
        .now_us = now_us,
        .uart_write = uart_write,
        .can_write = can_write,
        .pwm_set = pwm_set,
        .watchdog_kick = watchdog_kick,
    };
    sigset_t mask = catch_signals();
    uuv_hil_start(&firmware, &platform, (uint8_t)channels, (uint32_t)strtoul(argv[3], NULL, 10));
    printf("ready on %s\n", argv[1]);
    fflush(stdout);
    serve(&firmware, &mask);
    print_summary(&firmware);
    return 0;
}
