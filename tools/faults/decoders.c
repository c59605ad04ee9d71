/* Feeds inputs to the firmware's core, to be compiled under sanitizers.
 *
 *   decoders < INPUTS
 *
 * An input is a record: kind, microseconds since the last one (u16), size (u16), bytes. Kind 0 comes by the UART, kind 1
 * is frames of CAN as SocketCAN has them, of 16 bytes, kind 2 a sound packet at the end, which comes by the UART long
 * after the last one: one of these must still move the outputs. Each is in memory of exactly its size, so that a step
 * beyond it is seen. Prints how many commands were executed.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "uuv_hil_stm32.h"

enum { CHANNELS = 6, FRAME = 16, UART = 0, CAN = 1, SOUND = 2 };

static uint64_t sum, now;
static uint16_t outputs[UUV_HIL_MAX_CHANNELS];

static uint64_t now_us(void *context)
{
    (void)context;
    return now;
}

static void uart_write(void *context, const uint8_t *data, size_t size)
{
    (void)context;
    for (size_t i = 0; i < size; i++)
        sum += data[i]; /* reads every byte */
}

static void can_write(void *context, const UuvHilCanFrame *frame)
{
    uart_write(context, frame->data, frame->size <= 8 ? frame->size : 8);
}

static void pwm_set(void *context, const uint16_t *pulse_us, uint8_t channels)
{
    (void)context;
    memcpy(outputs, pulse_us, channels * sizeof *pulse_us);
}

static void watchdog_kick(void *context)
{
    (void)context;
}

static void receive_can(UuvHilFirmware *firmware, const uint8_t *bytes, size_t size)
{
    for (size_t at = 0; at + FRAME <= size; at += FRAME) {
        UuvHilCanFrame frame = {.size = (uint8_t)(bytes[at + 4] % 9)};
        memcpy(&frame.id, bytes + at, 4);
        memcpy(frame.data, bytes + at + 8, 8);
        uuv_hil_receive_can(firmware, &frame);
    }
}

int main(void)
{
    static UuvHilFirmware firmware;
    const UuvHilPlatform platform = {NULL, now_us, uart_write, can_write, pwm_set, watchdog_kick};
    uint8_t head[5];
    unsigned long commands = 0;
    bool moved = false;
    uuv_hil_start(&firmware, &platform, CHANNELS, UUV_HIL_WATCHDOG_US);
    while (fread(head, sizeof head, 1, stdin) == 1) {
        size_t size = (size_t)(head[3] | head[4] << 8);
        uint8_t *bytes = malloc(size ? size : 1);
        if (bytes == NULL || fread(bytes, 1, size, stdin) != size)
            return 2;
        uint16_t before = firmware.board.frames;
        now += (uint64_t)(head[1] | head[2] << 8);
        if (head[0] == SOUND) {
            now += 1000000; /* the watchdog trips: any sequence number counts */
            uuv_hil_service(&firmware, bytes, 0);
        }
        if (head[0] == CAN)
            receive_can(&firmware, bytes, size);
        else
            uuv_hil_service(&firmware, bytes, size);
        for (size_t i = 0; i < CHANNELS && head[0] == SOUND; i++)
            moved |= outputs[i] != UUV_HIL_PWM_NEUTRAL_US;
        commands += (uint16_t)(firmware.board.frames - before);
        free(bytes);
        if (firmware.board.channels != CHANNELS)
            return 1;
    }
    printf("%lu commands executed%s\n", commands, moved ? "" : "; a sound command is not executed any more");
    return !moved;
}
