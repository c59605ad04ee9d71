/* Main loop on the board: read bytes and frames, run the firmware, sleep. See stm32.h for the memory, chip.h for the pins. */

#include "stm32.h"

#define IWDG_KICK 0xAAAAu
#define IWDG_UNLOCK 0x5555u
#define IWDG_START 0xCCCCu

static UuvHilFirmware firmware;

/* 32 kHz / 32 = 1 kHz; 100 ms. The pins float while the STM32 starts again: no pulse. */
static void watchdog_start(void)
{
    IWDG_KR = IWDG_START;
    IWDG_KR = IWDG_UNLOCK;
    IWDG_PR = 3;
    IWDG_RLR = 100;
}

static void platform_watchdog_kick(void *context)
{
    (void)context;
    IWDG_KR = IWDG_KICK;
}

static uint64_t platform_now_us(void *context)
{
    (void)context;
    return clock_now_us();
}

static void platform_uart_write(void *context, const uint8_t *data, size_t size)
{
    (void)context;
    uart_write(data, size);
}

static void platform_can_write(void *context, const UuvHilCanFrame *frame)
{
    (void)context;
    can_write(frame);
}

static void platform_pwm_set(void *context, const uint16_t *pulse_us, uint8_t channels)
{
    (void)context;
    pwm_set(pulse_us, channels);
}

static const UuvHilPlatform platform = {
    .now_us = platform_now_us,
    .uart_write = platform_uart_write,
    .can_write = platform_can_write,
    .pwm_set = platform_pwm_set,
    .watchdog_kick = platform_watchdog_kick,
};

/* Sleep until a byte, a frame or the next millisecond; an interrupt just before the sleep ends it too. */
static void sleep(void)
{
    interrupts_off();
    if (uart_is_empty() && can_is_empty())
        wait_for_interrupt();
    interrupts_on();
}

int main(void)
{
    clock_start();
    watchdog_start();
    Parameters parameters = parameters_read();
    pwm_start(parameters.pwm_hz);
    uart_start(parameters.baud);
    can_start();
    uuv_hil_start(&firmware, &platform, (uint8_t)parameters.channels, parameters.watchdog_ms * 1000u);
    for (;;) {
        uint8_t bytes[64];
        UuvHilCanFrame frame;
        while (can_read(&frame))
            uuv_hil_receive_can(&firmware, &frame);
        size_t count = uart_read(bytes, sizeof bytes);
        uuv_hil_service(&firmware, bytes, count);
        sleep();
    }
}

/* After any fault: set the thrusters to neutral, and wait until the watchdog restarts the program. */
void Fault_Handler(void)
{
    const uint16_t neutral_us[OUTPUTS] = {1500, 1500, 1500, 1500, 1500, 1500, 1500, 1500};
    interrupts_off();
    pwm_set(neutral_us, OUTPUTS);
    for (;;) {
    }
}
