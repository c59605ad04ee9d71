/* Pins of the F4: the alternate function of a pin selects one of several peripherals. */

#include "stm32.h"

void pin_drive(uint32_t port, uint32_t pin, uint32_t function)
{
    GPIO_AFR(port, pin) |= function << 4 * (pin % 8);
    GPIO_MODER(port) |= 2u << 2 * pin;
}

void pin_read(uint32_t port, uint32_t pin, uint32_t function)
{
    GPIO_PUPDR(port) |= 1u << 2 * pin;
    pin_drive(port, pin, function);
}
