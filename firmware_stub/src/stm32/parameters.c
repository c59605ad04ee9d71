/* Parameters of the vehicle, from a separate sector of the flash: the program is the same for every vehicle. */

#include "stm32.h"

#define PARAMETERS_ADDRESS 0x08004000u

static uint32_t in_range_or(uint32_t value, uint32_t low, uint32_t high, uint32_t default_value)
{
    return value >= low && value <= high ? value : default_value;
}

Parameters parameters_read(void)
{
    const volatile Parameters *stored = (const volatile Parameters *)PARAMETERS_ADDRESS;
    bool valid = stored->magic == PARAMETERS_MAGIC;
    return (Parameters){
        .magic = PARAMETERS_MAGIC,
        .channels = in_range_or(valid ? stored->channels : 0, 1, OUTPUTS, 6),
        .watchdog_ms = in_range_or(valid ? stored->watchdog_ms : 0, 10, 60000, 200),
        .pwm_hz = in_range_or(valid ? stored->pwm_hz : 0, 50, 400, 50),
        .baud = in_range_or(valid ? stored->baud : 0, 9600, UART_HZ / 16, 115200),
    };
}
