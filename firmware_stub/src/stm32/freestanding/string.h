/* All that the firmware uses of the C library's string.h; startup.c has the bodies. */
#ifndef UUV_HIL_F405_STRING_H
#define UUV_HIL_F405_STRING_H

#include <stddef.h>

void *memcpy(void *restrict to, const void *restrict from, size_t size);
void *memset(void *to, int value, size_t size);

#endif
