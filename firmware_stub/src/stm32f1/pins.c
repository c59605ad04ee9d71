/* Pins of the F1: each is connected to its peripheral without remapping, as after a reset. */

#include "stm32.h"

#define DRIVEN 10u      /* by the peripheral, push-pull, up to 2 MHz */
#define READ_PULLED 8u  /* up or down, by the output register */

static void set_mode(uint32_t port, uint32_t pin, uint32_t mode)
{
    uint32_t place = 4 * (pin % 8);
    GPIO_CR(port, pin) = (GPIO_CR(port, pin) & ~(15u << place)) | mode << place;
}

void pin_drive(uint32_t port, uint32_t pin, uint32_t function)
{
    (void)function;
    set_mode(port, pin, DRIVEN);
}

void pin_read(uint32_t port, uint32_t pin, uint32_t function)
{
    (void)function;
    GPIO_BSRR(port) = BIT(pin);
    set_mode(port, pin, READ_PULLED);
}
