/* Random and damaged input to the firmware's core, to be compiled under sanitizers.
 *
 *   decoders COUNT SEED CORPUS    CORPUS: records of u16 size and bytes, sound packets of all that is spoken
 *
 * An input is noise, or one or two packets of the corpus with bits flipped, bytes lost, doubled or put in; every third
 * goes to the CAN decoder as frames. Each is copied to memory of exactly its size, so that a step beyond it is seen. At
 * the end a sound command must still move the outputs. Prints how many inputs and bytes it was, and how many commands
 * were executed.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "uuv_hil_stm32.h"

enum { LONGEST = 640, PACKETS = 256, CHANNELS = 6 };

typedef struct {
    uint8_t bytes[LONGEST];
    uint16_t size;
} Packet;

static Packet corpus[PACKETS];
static size_t packets;
static uint64_t state, now;
static uint16_t outputs[UUV_HIL_MAX_CHANNELS];

static uint64_t next(void)
{
    state ^= state << 13, state ^= state >> 7, state ^= state << 17;
    return state;
}

static size_t below(size_t bound)
{
    return (size_t)(next() % bound);
}

static uint64_t now_us(void *context)
{
    (void)context;
    return now;
}

static void uart_write(void *context, const uint8_t *data, size_t size)
{
    (void)context;
    for (size_t i = 0; i < size; i++)
        state += data[i]; /* reads every byte */
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

static void read_corpus(const char *path)
{
    FILE *file = fopen(path, "rb");
    if (file == NULL)
        exit(2);
    while (packets < PACKETS && fread(&corpus[packets].size, 2, 1, file) == 1) {
        Packet *packet = &corpus[packets++];
        if (packet->size > LONGEST || fread(packet->bytes, 1, packet->size, file) != packet->size)
            exit(2);
    }
    fclose(file);
}

static void mutate(uint8_t *bytes, size_t *size)
{
    size_t place = *size ? below(*size) : 0, count = 1 + below(8);
    switch (below(4)) {
    case 0:
        if (*size)
            bytes[place] ^= (uint8_t)(1u << below(8));
        return;
    case 1:
        if (*size)
            bytes[place] = (uint8_t)next();
        return;
    case 2:
        if (count > *size - place)
            count = *size - place;
        memmove(bytes + place, bytes + place + count, *size - place - count);
        *size -= count;
        return;
    default:
        if (*size + count > LONGEST)
            return;
        memmove(bytes + place + count, bytes + place, *size - place);
        for (size_t i = 0; i < count; i++)
            bytes[place + i] = (uint8_t)next();
        *size += count;
    }
}

static size_t make_input(uint8_t *bytes)
{
    size_t size = 0;
    if (packets == 0 || below(3) == 0) {
        size = below(120);
        for (size_t i = 0; i < size; i++)
            bytes[i] = (uint8_t)next();
        return size;
    }
    for (size_t i = 0, many = 1 + below(2); i < many; i++) {
        const Packet *packet = &corpus[below(packets)];
        if (size + packet->size <= LONGEST) {
            memcpy(bytes + size, packet->bytes, packet->size);
            size += packet->size;
        }
    }
    for (size_t i = below(4); i > 0; i--)
        mutate(bytes, &size);
    return size;
}

static void hear(UuvHilFirmware *firmware, const uint8_t *bytes, size_t size)
{
    uint8_t *exact = malloc(size ? size : 1);
    memcpy(exact, bytes, size);
    uuv_hil_service(firmware, exact, size);
    free(exact);
}

static void receive_can(UuvHilFirmware *firmware, const uint8_t *bytes, size_t size)
{
    for (size_t at = 0; at + 13 <= size; at += 13) {
        UuvHilCanFrame frame = {.size = (uint8_t)(bytes[at + 4] % 9)};
        memcpy(&frame.id, bytes + at, 4);
        if (below(2)) /* one that is for us, more often than chance would have it */
            frame.id = (uint32_t)(below(64) << 8 | below(20));
        memcpy(frame.data, bytes + at + 5, 8);
        uuv_hil_receive_can(firmware, &frame);
    }
}

/* Whether sound packets still move the outputs: every one is sent, neutral and not, until one does. */
static bool still_executes(UuvHilFirmware *firmware)
{
    for (size_t turn = 0; turn < 4 * packets; turn++) {
        now += 1000000; /* the watchdog has tripped: any sequence number counts */
        hear(firmware, corpus[0].bytes, 0);
        hear(firmware, corpus[turn % packets].bytes, corpus[turn % packets].size);
        for (size_t i = 0; i < CHANNELS; i++)
            if (outputs[i] != UUV_HIL_PWM_NEUTRAL_US)
                return true;
    }
    return packets == 0;
}

int main(int argc, char **argv)
{
    static UuvHilFirmware firmware;
    const UuvHilPlatform platform = {NULL, now_us, uart_write, can_write, pwm_set, watchdog_kick};
    if (argc != 4)
        return 2;
    unsigned long count = strtoul(argv[1], NULL, 10), commands = 0, size_total = 0;
    state = strtoul(argv[2], NULL, 10) * 2654435769u + 1u;
    read_corpus(argv[3]);
    uuv_hil_start(&firmware, &platform, CHANNELS, UUV_HIL_WATCHDOG_US);
    for (unsigned long i = 0; i < count; i++) {
        uint8_t bytes[LONGEST];
        size_t size = make_input(bytes);
        uint16_t before = firmware.board.frames;
        now += below(2000);
        if (i % 3 == 0)
            receive_can(&firmware, bytes, size);
        else
            hear(&firmware, bytes, size);
        commands += (uint16_t)(firmware.board.frames - before);
        size_total += size;
        if (firmware.board.channels != CHANNELS)
            return 1;
    }
    printf("%lu inputs, %lu bytes, %lu commands executed\n", count, size_total, commands);
    if (!still_executes(&firmware)) {
        printf("a sound command is not executed any more\n");
        return 1;
    }
    return 0;
}
