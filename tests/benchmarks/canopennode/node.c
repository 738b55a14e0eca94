/* A node on CANopenNode that is stepped from outside: no thread, no clock, no bus of its own.
 *
 * The caller builds the dictionary (`node_object` for each sub-index in ascending order), begins with `node_start`,
 * hands in frames (`node_receive`) and time (`node_process`), and takes frames, writes and states by callbacks.
 */
#include <stdlib.h>
#include <string.h>

#define OD_DEFINITION
#include "CANopen.h"

#define LARGEST 512
#define CALLS_AT_ONCE 16
/* An error of the communication takes the node out of OPERATIONAL, as CiA 301 has it for 0x1029 = 0. */
#define NMT_CONTROL (CO_NMT_ERR_ON_BUSOFF_HB | CO_NMT_ERR_ON_ERR_REG | CO_ERR_REG_COMMUNICATION)
#define SDO_TIMEOUT_MS 1000

typedef void (*send_fn)(uint16_t cob_id, const uint8_t* data, uint8_t length);
/* is_done 0: may this be written (the answer is an ODR_t); 1: it has been written. */
typedef int (*write_fn)(uint16_t index, uint8_t sub, const uint8_t* data, uint32_t length, int is_done);
typedef void (*state_fn)(int state);
typedef void (*lost_fn)(int node_id);

typedef struct node {
    OD_t od;
    OD_entry_t entries[LARGEST];
    OD_obj_record_t subs[LARGEST];
    OD_obj_var_t vars[LARGEST];
    OD_extension_t hooks[LARGEST];
    uint8_t* defaults[LARGEST];
    uint16_t indices[LARGEST];
    int count, entry_count;
    CO_config_t config;
    CO_t* co;
    uint8_t node_id;
    send_fn send;
    write_fn written;
    state_fn changed;
    lost_fn lost;
} node_t;

/* The callback of the NMT state names no object: the node that is being processed. One thread. */
static node_t* current;

/* The driver -------------------------------------------------------------------------------------------------------- */

void CO_CANsetConfigurationMode(void* CANptr) { (void)CANptr; }

void CO_CANsetNormalMode(CO_CANmodule_t* module) { module->CANnormal = true; }

void CO_CANmodule_disable(CO_CANmodule_t* module) {
    if (module != NULL) {
        module->CANnormal = false;
    }
}

CO_ReturnError_t CO_CANmodule_init(CO_CANmodule_t* module, void* CANptr, CO_CANrx_t rx[], uint16_t rx_size,
                                   CO_CANtx_t tx[], uint16_t tx_size, uint16_t rate) {
    (void)rate;
    memset(module, 0, sizeof(*module));
    memset(rx, 0, rx_size * sizeof(*rx));
    memset(tx, 0, tx_size * sizeof(*tx));
    module->CANptr = CANptr;
    module->rxArray = rx;
    module->rxSize = rx_size;
    module->txArray = tx;
    module->txSize = tx_size;
    for (uint16_t i = 0; i < rx_size; i++) {
        rx[i].mask = 0xFFFF;
    }
    return CO_ERROR_NO;
}

CO_ReturnError_t CO_CANrxBufferInit(CO_CANmodule_t* module, uint16_t index, uint16_t ident, uint16_t mask, bool_t rtr,
                                    void* object, void (*taker)(void*, void*)) {
    if (module == NULL || object == NULL || taker == NULL || index >= module->rxSize || rtr) {
        return CO_ERROR_ILLEGAL_ARGUMENT;
    }
    module->rxArray[index] = (CO_CANrx_t){ident & 0x7FF, mask & 0x7FF, object, taker};
    return CO_ERROR_NO;
}

CO_CANtx_t* CO_CANtxBufferInit(CO_CANmodule_t* module, uint16_t index, uint16_t ident, bool_t rtr, uint8_t length,
                               bool_t is_synchronous) {
    (void)rtr;
    if (module == NULL || index >= module->txSize) {
        return NULL;
    }
    CO_CANtx_t* buffer = &module->txArray[index];
    buffer->ident = ident & 0x7FF;
    buffer->DLC = length;
    buffer->bufferFull = false;
    buffer->syncFlag = is_synchronous;
    return buffer;
}

CO_ReturnError_t CO_CANsend(CO_CANmodule_t* module, CO_CANtx_t* buffer) {
    node_t* node = module->CANptr;
    if (module->CANnormal) {
        node->send((uint16_t)buffer->ident, buffer->data, buffer->DLC);
    }
    return CO_ERROR_NO;
}

void CO_CANclearPendingSyncPDOs(CO_CANmodule_t* module) { (void)module; }

void CO_CANmodule_process(CO_CANmodule_t* module) { (void)module; }

/* The dictionary ---------------------------------------------------------------------------------------------------- */

static ODR_t write_hooked(OD_stream_t* stream, const void* buf, OD_size_t count, OD_size_t* count_written) {
    node_t* node = stream->object;
    int answer = node->written(stream->index, stream->subIndex, buf, count, 0);
    if (answer != ODR_OK) {
        return (ODR_t)answer;
    }
    ODR_t result = OD_writeOriginal(stream, buf, count, count_written);
    if (result == ODR_OK) {
        (void)node->written(stream->index, stream->subIndex, buf, count, 1);
    }
    return result;
}

node_t* node_new(uint8_t node_id, send_fn send, write_fn written, state_fn changed, lost_fn lost) {
    node_t* node = calloc(1, sizeof(*node));
    node->node_id = node_id;
    node->send = send;
    node->written = written;
    node->changed = changed;
    node->lost = lost;
    return node;
}

/* One sub-index, in ascending order of index and sub-index; 0 where there is no room. */
int node_object(node_t* node, uint16_t index, uint8_t sub, int is_record, uint8_t attribute, const uint8_t* value,
                uint32_t length, int is_hooked) {
    if (node->count >= LARGEST) {
        return 0;
    }
    int at = node->count++;
    uint8_t* data = calloc(1, length + 1);
    memcpy(data, value, length);
    node->defaults[at] = calloc(1, length + 1);
    memcpy(node->defaults[at], value, length);
    node->indices[at] = index;
    node->subs[at] = (OD_obj_record_t){data, sub, attribute, length};
    node->vars[at] = (OD_obj_var_t){data, attribute, length};
    OD_entry_t* last = node->entry_count ? &node->entries[node->entry_count - 1] : NULL;
    if (last != NULL && last->index == index) {
        last->subEntriesCount++;
    } else {
        last = &node->entries[node->entry_count++];
        *last = (OD_entry_t){index, 1, is_record ? ODT_REC : ODT_VAR,
                             is_record ? (void*)&node->subs[at] : (void*)&node->vars[at], NULL};
    }
    if (is_hooked && last->extension == NULL) {
        last->extension = &node->hooks[at];
        last->extension->object = node;
        last->extension->read = OD_readOriginal;
        last->extension->write = write_hooked;
    }
    return 1;
}

uint8_t* node_memory(node_t* node, uint16_t index, uint8_t sub) {
    for (int i = 0; i < node->count; i++) {
        if (node->indices[i] == index && node->subs[i].subIndex == sub) {
            return node->subs[i].dataOrig;
        }
    }
    return NULL;
}

static void restore(node_t* node, bool_t is_application) {
    for (int i = 0; i < node->count; i++) {
        if (is_application || node->indices[i] < 0x2000) {
            memcpy(node->subs[i].dataOrig, node->defaults[i], node->subs[i].dataLength);
        }
    }
}

static int counted(node_t* node, uint16_t first) {
    int count = 0;
    while (OD_find(&node->od, (uint16_t)(first + count)) != NULL) {
        count++;
    }
    return count;
}

static void configure(node_t* node) {
    CO_config_t* c = &node->config;
    node->od.size = (uint16_t)node->entry_count;
    node->od.list = node->entries;
#define FOUND(index) OD_find(&node->od, 0x##index)
    c->CNT_NMT = c->CNT_HB_CONS = c->CNT_EM = c->CNT_SDO_SRV = c->CNT_SYNC = 1;
    c->ENTRY_H1017 = FOUND(1017);
    c->ENTRY_H1016 = FOUND(1016);
    c->CNT_ARR_1016 = (uint8_t)(c->ENTRY_H1016->subEntriesCount - 1);
    c->ENTRY_H1001 = FOUND(1001);
    c->ENTRY_H1014 = FOUND(1014);
    c->ENTRY_H1015 = FOUND(1015);
    c->ENTRY_H1003 = FOUND(1003);
    c->CNT_ARR_1003 = (uint8_t)(c->ENTRY_H1003->subEntriesCount - 1);
    c->ENTRY_H1200 = FOUND(1200);
    c->ENTRY_H1005 = FOUND(1005);
    c->ENTRY_H1006 = FOUND(1006);
    c->ENTRY_H1007 = FOUND(1007);
    c->ENTRY_H1019 = FOUND(1019);
    c->CNT_RPDO = (uint16_t)counted(node, 0x1400);
    c->ENTRY_H1400 = FOUND(1400);
    c->ENTRY_H1600 = FOUND(1600);
    c->CNT_TPDO = (uint16_t)counted(node, 0x1800);
    c->ENTRY_H1800 = FOUND(1800);
    c->ENTRY_H1A00 = FOUND(1A00);
}

/* Frames and time --------------------------------------------------------------------------------------------------- */

static void on_state(CO_NMT_internalState_t state) { current->changed((int)state); }

static void on_lost(uint8_t node_id, uint8_t idx, void* object) {
    (void)idx;
    ((node_t*)object)->lost(node_id);
}

static int begin(node_t* node) {
    uint32_t info = 0;
    CO_t* co = node->co;
    current = node;
    co->CANmodule->CANnormal = false;
    int err = CO_CANinit(co, node, 1000);
    if (err == CO_ERROR_NO) {
        err = CO_CANopenInit(co, NULL, NULL, &node->od, NULL, NMT_CONTROL, 0, SDO_TIMEOUT_MS, SDO_TIMEOUT_MS, false,
                             node->node_id, &info);
    }
    if (err == CO_ERROR_NO) {
        err = CO_CANopenInitPDO(co, co->em, &node->od, node->node_id, &info);
    }
    if (err != CO_ERROR_NO) {
        return (int)(info << 8 | (uint32_t)(err & 0xFF));
    }
    CO_NMT_initCallbackChanged(co->NMT, on_state);
    for (uint8_t i = 0; i < node->config.CNT_ARR_1016; i++) {
        CO_HBconsumer_initCallbackTimeout(co->HBcons, i, node, on_lost);
    }
    CO_CANsetNormalMode(co->CANmodule);
    return 0;
}

/* The power comes on, or comes back: everything at its default. 0, else index << 16 | sub << 8 | the stack's error. */
int node_start(node_t* node) {
    if (node->co == NULL) {
        configure(node);
        node->co = CO_new(&node->config, NULL);
        if (node->co == NULL) {
            return 0xFF;
        }
    }
    restore(node, true);
    return begin(node);
}

static CO_NMT_reset_cmd_t step(node_t* node, uint32_t elapsed_us, uint32_t* next_us) {
    CO_t* co = node->co;
    CO_NMT_reset_cmd_t reset = CO_process(co, false, elapsed_us, next_us);
    bool_t was = CO_process_SYNC(co, elapsed_us, next_us);
    CO_process_RPDO(co, was, elapsed_us, next_us);
    CO_process_TPDO(co, was, elapsed_us, next_us);
    return reset;
}

/* So much time has passed; microseconds until there is something to do again, at most `longest_us`. */
uint32_t node_process(node_t* node, uint32_t elapsed_us, uint32_t longest_us) {
    uint32_t next_us = 0;
    for (int call = 0; call < CALLS_AT_ONCE && next_us == 0; call++) {
        current = node;
        next_us = longest_us;
        CO_NMT_reset_cmd_t reset = step(node, elapsed_us, &next_us);
        elapsed_us = 0;
        if (reset == CO_RESET_COMM || reset == CO_RESET_APP) {
            restore(node, reset == CO_RESET_APP);
            if (begin(node) != 0) {
                return longest_us;
            }
            next_us = 0;
        }
    }
    return next_us;
}

void node_receive(node_t* node, uint16_t cob_id, const uint8_t* data, uint8_t length) {
    frame_t frame = {.ident = cob_id, .DLC = length};
    memcpy(frame.data, data, length);
    CO_CANmodule_t* module = node->co->CANmodule;
    for (uint16_t i = 0; module->CANnormal && i < module->rxSize; i++) {
        CO_CANrx_t* buffer = &module->rxArray[i];
        if (buffer->CANrx_callback != NULL && ((cob_id ^ buffer->ident) & buffer->mask) == 0
            && !(buffer->ident == 0 && i != 0)) {
            buffer->CANrx_callback(buffer->object, &frame);
            return;
        }
    }
}

int node_state(node_t* node) { return (int)CO_NMT_getInternalState(node->co->NMT); }

void node_set_state(node_t* node, int command) {
    CO_NMT_sendInternalCommand(node->co->NMT, (CO_NMT_command_t)command);
}

/* The device reports an error of its own (bit 0 to 15 of those), or takes it back. */
void node_error(node_t* node, int bit, uint16_t code, uint32_t info, int is_there) {
    CO_error(node->co->em, is_there != 0, (uint8_t)(CO_EM_MANUFACTURER_START + bit), code, info);
}

void node_delete(node_t* node) {
    CO_delete(node->co);
    for (int i = 0; i < node->count; i++) {
        free(node->subs[i].dataOrig);
        free(node->defaults[i]);
    }
    free(node);
}
