/* The firmware as a Linux process on a pseudo terminal: uuv-hil-stm32-native. POSIX, except for die_with_parent. */

#define _GNU_SOURCE /* F_SETSIG */

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "pty.h"
#include "uuv_hil_stm32.h"

#define NAME "uuv-hil-stm32-native"
#define USAGE                                                                                                          \
    "usage: " NAME " [--device PATH] [--channels N] [--watchdog TIME]\n"                                               \
    "  --device PATH     the pty to make [/tmp/uuv-hil-stm32]\n"                                                       \
    "  --channels N      number of thrusters, 1 to 16 [6]\n"                                                           \
    "  --watchdog TIME   longest silence before all thrusters stop, such as \"200 ms\" or \"0.2 s\" [200 ms]\n"

enum { BAD_OPTION = 2, BAD_DEVICE = 3 };

typedef struct {
    const char *device;
    uint8_t channels;
    uint32_t watchdog_us;
} Options;

static volatile sig_atomic_t stop_requested;

static void on_signal(int number)
{
    (void)number;
    stop_requested = 1;
}

static bool report_option(const char *option, const char *value, const char *remedy)
{
    fprintf(stderr, NAME ": %s: %s %s\n", option, value, remedy);
    return false;
}

static bool read_channels(const char *text, uint8_t *channels)
{
    char *end;
    long value = strtol(text, &end, 10);
    if (end == text || *end != '\0' || value < 1 || value > (long)UUV_HIL_MAX_CHANNELS)
        return report_option("--channels", text, "is not a number from 1 to 16");
    *channels = (uint8_t)value;
    return true;
}

static bool read_time(const char *text, uint32_t *time_us)
{
    char *end;
    double value = strtod(text, &end);
    while (*end == ' ')
        end++;
    double unit_us = strcmp(end, "ms") == 0 ? 1e3 : strcmp(end, "s") == 0 ? 1e6 : 0.0;
    if (end == text || unit_us == 0.0)
        return report_option("--watchdog", text, "has no unit; write it as 200 ms or 0.2 s");
    if (!(value * unit_us >= 1e4 && value * unit_us <= 60e6))
        return report_option("--watchdog", text, "is outside 10 ms to 60 s");
    *time_us = (uint32_t)(value * unit_us + 0.5);
    return true;
}

static bool read_option(const char *name, const char *value, Options *options)
{
    if (value == NULL)
        return report_option(name, "", "needs a value, or is no option (see --help)");
    if (strcmp(name, "--device") == 0) {
        options->device = value;
        return true;
    }
    if (strcmp(name, "--channels") == 0)
        return read_channels(value, &options->channels);
    if (strcmp(name, "--watchdog") == 0)
        return read_time(value, &options->watchdog_us);
    return report_option(name, value, "is no option (see --help)");
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
    pty_write(context, data, size);
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

static void wait_until(uint64_t deadline_us, int fd, const sigset_t *mask)
{
    uint64_t now = now_us(NULL);
    uint64_t left_us = deadline_us > now ? deadline_us - now : 0;
    struct timespec timeout = {.tv_sec = (time_t)(left_us / 1000000u), .tv_nsec = (long)(left_us % 1000000u) * 1000};
    fd_set readable;
    FD_ZERO(&readable);
    FD_SET(fd, &readable);
    pselect(fd + 1, &readable, NULL, NULL, &timeout, mask);
}

/* After a pause longer than the watchdog's time, discard the bytes received meanwhile, as a UART does. The time is taken
 * after the read: a pause between the two would hide how old the bytes are. */
static size_t read_recent(Pty *pty, uint8_t *bytes, size_t size, uint64_t *read_us, uint32_t limit_us)
{
    size_t count = pty_read(pty, bytes, size);
    uint64_t now = now_us(NULL);
    bool was_stopped = now - *read_us > limit_us;
    for (int reads = 0; was_stopped && count > 0 && reads < 256; reads++)
        count = pty_read(pty, bytes, size);
    *read_us = now;
    return was_stopped ? 0 : count;
}

static void serve(UuvHilFirmware *firmware, Pty *pty, const sigset_t *mask)
{
    uint64_t read_us = now_us(NULL);
    while (!stop_requested) {
        uint8_t bytes[4096];
        size_t count = read_recent(pty, bytes, sizeof bytes, &read_us, firmware->board.watchdog_us);
        uuv_hil_service(firmware, bytes, count);
        wait_until(uuv_hil_deadline_us(firmware), pty->master_fd, mask);
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

static int run(const Options *options)
{
    static Pty pty;
    static UuvHilFirmware firmware;
    if (!pty_open(&pty, options->device)) {
        fprintf(stderr, NAME ": %s\n", pty.problem);
        return BAD_DEVICE;
    }
    const UuvHilPlatform platform = {
        .context = &pty,
        .now_us = now_us,
        .uart_write = uart_write,
        .can_write = can_write,
        .pwm_set = pwm_set,
        .watchdog_kick = watchdog_kick,
    };
    sigset_t mask = catch_signals();
    uuv_hil_start(&firmware, &platform, options->channels, options->watchdog_us);
    printf("STM32 with %u thrusters on %s: watchdog %g ms; Ctrl-C ends it\n", options->channels, pty.link_path,
           options->watchdog_us / 1e3);
    fflush(stdout);
    serve(&firmware, &pty, &mask);
    pty_close(&pty);
    print_summary(&firmware);
    return 0;
}

int main(int argc, char **argv)
{
    Options options = {.device = "/tmp/uuv-hil-stm32", .channels = 6, .watchdog_us = UUV_HIL_WATCHDOG_US};
    if (argc == 2 && strcmp(argv[1], "--help") == 0) {
        fputs(USAGE, stdout);
        return 0;
    }
    die_with_parent();
    for (int i = 1; i < argc; i += 2)
        if (!read_option(argv[i], argv[i + 1], &options))
            return BAD_OPTION;
    return run(&options);
}
