/* In place of can.c for a chip that has no CAN controller. */

#include "stm32.h"

void can_start(void)
{
}

bool can_is_empty(void)
{
    return true;
}

bool can_read(UuvHilCanFrame *frame)
{
    (void)frame;
    return false;
}

void can_write(const UuvHilCanFrame *frame)
{
    (void)frame;
}

void CAN_TX_Handler(void)
{
    Fault_Handler();
}

void CAN_RX0_Handler(void)
{
    Fault_Handler();
}
