/* What of CANopenNode is built: a slave with NMT, heartbeat both ways, EMCY, SDO server, SYNC and PDOs. Included before
 * every file of the stack (gcc -include). */
#ifndef STACK_CONFIG_H
#define STACK_CONFIG_H

#define CO_MULTIPLE_OD
#define CO_CONFIG_GLOBAL_FLAG_TIMERNEXT 0x2000
#define CO_CONFIG_NMT                   (0x2000 | 0x01)        /* next due; callback when the state changes */
#define CO_CONFIG_HB_CONS               (0x4000 | 0x2000 | 0x01 | 0x04) /* one callback for each event */
#define CO_CONFIG_LSS                   0
#define CO_CONFIG_TIME                  0
#define CO_CONFIG_STORAGE               0
#define CO_CONFIG_LEDS                  0

/* Error bits 0x30 to 0x3F are the device's own errors: generic and profile bit of the error register. */
#define CO_CONFIG_ERR_CONDITION_GENERIC     (em->errorStatusBits[5] || em->errorStatusBits[6] || em->errorStatusBits[7])
#define CO_CONFIG_ERR_CONDITION_DEV_PROFILE (em->errorStatusBits[6] || em->errorStatusBits[7])

#endif
