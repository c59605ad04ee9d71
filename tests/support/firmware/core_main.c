/* The firmware's core with time and line from standard input, and what it does to standard output. Little-endian.
 *
 *   core run       in:   u8 channels, u32 watchdog_us; then records: u64 now_us, u16 size, bytes; a record of size
 *                        65535 has no bytes and stops the firmware; one of size 65534 is a CAN frame: u32 id, u8 size,
 *                        u8[8]
 *                  out:  a record: u16 size, the bytes sent; u16 count, the CAN frames sent; u16[16] pulses; u32 times
 *                        that the watchdog was kicked; u64 deadline_us
 *   core encode    in:   u16 sequence, u8 armed, u8 timed_out, u8 channels, u32 age_us, u16 frames, u16 errors,
 *                        u16 watchdog_trips, u16[16] pulses
 *                  out:  the frame of that report
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "uuv_hil_stm32.h"

enum { STOP = 65535, CAN = 65534, CAN_RECORD_SIZE = 13 };

typedef struct {
    uint64_t now_us;
    uint8_t sent[65536];
    size_t sent_size;
    uint8_t sent_can[256][CAN_RECORD_SIZE];
    uint16_t sent_can_count;
    uint16_t pwm_us[UUV_HIL_MAX_CHANNELS];
    uint32_t kicks;
} Bench;

static uint64_t now_us(void *context)
{
    return ((Bench *)context)->now_us;
}

static void uart_write(void *context, const uint8_t *data, size_t size)
{
    Bench *bench = context;
    if (bench->sent_size + size > sizeof bench->sent)
        return;
    memcpy(bench->sent + bench->sent_size, data, size);
    bench->sent_size += size;
}

static void can_write(void *context, const UuvHilCanFrame *frame)
{
    Bench *bench = context;
    uint8_t *record = bench->sent_can[bench->sent_can_count++ % 256];
    memcpy(record, &frame->id, 4);
    record[4] = frame->size;
    memcpy(record + 5, frame->data, 8);
}

static void pwm_set(void *context, const uint16_t *pulse_us, uint8_t channels)
{
    memcpy(((Bench *)context)->pwm_us, pulse_us, channels * sizeof *pulse_us);
}

static void watchdog_kick(void *context)
{
    ((Bench *)context)->kicks++;
}

static void get(void *to, size_t size)
{
    if (fread(to, size, 1, stdin) != 1)
        exit(1);
}

static void put(const void *from, size_t size)
{
    if (size > 0 && fwrite(from, size, 1, stdout) != 1)
        exit(1);
}

/* Exactly as big as the bytes, so that the address sanitizer sees a step beyond them. */
static void service(UuvHilFirmware *firmware, uint16_t size)
{
    uint8_t *bytes = malloc(size);
    if (size > 0)
        get(bytes, size);
    uuv_hil_service(firmware, bytes, size);
    free(bytes);
}

static void receive_can(UuvHilFirmware *firmware)
{
    UuvHilCanFrame frame;
    get(&frame.id, sizeof frame.id);
    get(&frame.size, sizeof frame.size);
    get(frame.data, sizeof frame.data);
    uuv_hil_receive_can(firmware, &frame);
}

static void answer(Bench *bench, const UuvHilFirmware *firmware)
{
    uint16_t size = (uint16_t)bench->sent_size;
    uint64_t deadline_us = uuv_hil_deadline_us(firmware);
    put(&size, sizeof size);
    put(bench->sent, size);
    put(&bench->sent_can_count, sizeof bench->sent_can_count);
    put(bench->sent_can, bench->sent_can_count * sizeof bench->sent_can[0]);
    put(bench->pwm_us, sizeof bench->pwm_us);
    put(&bench->kicks, sizeof bench->kicks);
    put(&deadline_us, sizeof deadline_us);
    bench->sent_size = bench->sent_can_count = 0;
}

static int run(void)
{
    static Bench bench;
    static UuvHilFirmware firmware;
    const UuvHilPlatform platform = {&bench, now_us, uart_write, can_write, pwm_set, watchdog_kick};
    uint8_t channels;
    uint32_t watchdog_us;
    get(&channels, sizeof channels);
    get(&watchdog_us, sizeof watchdog_us);
    uuv_hil_start(&firmware, &platform, channels, watchdog_us);
    while (fread(&bench.now_us, sizeof bench.now_us, 1, stdin) == 1) {
        uint16_t size;
        get(&size, sizeof size);
        if (size == STOP)
            uuv_hil_stop(&firmware);
        else if (size == CAN)
            receive_can(&firmware);
        else
            service(&firmware, size);
        answer(&bench, &firmware);
    }
    return 0;
}

static int encode(void)
{
    UuvHilTelemetry telemetry;
    uint8_t flags[2], frame[UUV_HIL_FRAME_TELEMETRY_FRAME_SIZE_MAX];
    get(&telemetry.sequence, 2);
    get(flags, 2);
    telemetry.armed = flags[0], telemetry.timed_out = flags[1];
    get(&telemetry.channels, 1);
    get(&telemetry.age_us, 4);
    get(&telemetry.frames, 2);
    get(&telemetry.errors, 2);
    get(&telemetry.watchdog_trips, 2);
    get(telemetry.pwm_us, sizeof telemetry.pwm_us);
    put(frame, uuv_hil_frame_encode(&telemetry, frame));
    return 0;
}

int main(int argc, char **argv)
{
    return argc > 1 && strcmp(argv[1], "encode") == 0 ? encode() : run();
}
