/*
 * Where large constants lie. An AVR would copy them into its small RAM: there they stay in the flash, of which a
 * function reads numbers of 32 bits.
 */
#ifndef SWINGUP_FLASH_H
#define SWINGUP_FLASH_H

#ifdef __AVR__
#include <avr/pgmspace.h>
#define SWINGUP_FLASH PROGMEM
#define SWINGUP_READ(address) pgm_read_float(address)
#else
#define SWINGUP_FLASH
#define SWINGUP_READ(address) (*(address))
#endif

#endif
