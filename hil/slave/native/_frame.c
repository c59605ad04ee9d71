/* Packs and reads the one frame of firmware_stub/frames/uuv_hil.toml: hil.slave.native._frame.
 *
 * What hil/links/frame/protocol.py does for any frame, for the usual case of this one: a message whose numbers all fit,
 * and bytes that are exactly one sound frame. Everything else is None here, and left to that.
 */

#include "../../../sim/native/numbers.h"

#include "uuv_hil_stm32.h"

enum { MOST = UUV_HIL_FRAME_MAX_THRUSTERS };

/* The fields of the named tuples in hil/links/contract.py, in their order. */
enum { COMMAND_SEQUENCE, COMMAND_ARMED, COMMAND_PWM_US, COMMAND_FIELDS };
enum { SEQUENCE, ARMED, TIMED_OUT, PWM_US, AGE_US, FRAMES, ERRORS, WATCHDOG_TRIPS, TELEMETRY_FIELDS };

static PyTypeObject *command_type, *telemetry_type;

static uint16_t crc_of(const uint8_t *frame, size_t end)
{
    return uuv_hil_crc16(frame + UUV_HIL_FRAME_CRC_START, end - UUV_HIL_FRAME_CRC_START);
}

static void put(uint8_t *to, uint32_t value, int bytes)
{
    for (int i = 0; i < bytes; i++)
        to[i] = (uint8_t)(value >> 8 * i);
}

static uint32_t get(const uint8_t *from, int bytes)
{
    uint32_t value = 0;
    for (int i = 0; i < bytes; i++)
        value |= (uint32_t)from[i] << 8 * i;
    return value;
}

/* A field of a message as a number of so many bytes at `to`; 0 if it is none that fits. */
static int put_field(PyObject *message, Py_ssize_t field, uint8_t *to, int bytes)
{
    PyObject *item = PyTuple_GetItem(message, field);
    long long value = item == NULL ? -1 : PyLong_AsLongLong(item);
    if (value < 0 || value >> 8 * bytes) {
        PyErr_Clear();
        return 0;
    }
    put(to, (uint32_t)value, bytes);
    return 1;
}

static int put_pulses(PyObject *pulses, Py_ssize_t count, uint8_t *to)
{
    for (Py_ssize_t i = 0; i < count; i++)
        if (!put_field(pulses, i, to + 2 * i, 2))
            return 0;
    return 1;
}

static int is_true(PyObject *message, Py_ssize_t field)
{
    PyObject *item = PyTuple_GetItem(message, field);
    return item != NULL && PyObject_IsTrue(item) == 1;
}

static PyObject *finish(uint8_t *frame, uint8_t id, size_t size)
{
    size_t end = size - UUV_HIL_FRAME_CRC_SIZE;
    frame[0] = UUV_HIL_FRAME_SYNC_0;
    frame[1] = UUV_HIL_FRAME_SYNC_1;
    frame[UUV_HIL_FRAME_LENGTH] = (uint8_t)(end - UUV_HIL_FRAME_PAYLOAD);
    frame[UUV_HIL_FRAME_ID] = id;
    put(frame + end, crc_of(frame, end), UUV_HIL_FRAME_CRC_SIZE);
    return PyBytes_FromStringAndSize((char *)frame, (Py_ssize_t)size);
}

static PyObject *pack_command(PyObject *message, PyObject *pulses, Py_ssize_t count)
{
    uint8_t frame[UUV_HIL_FRAME_COMMAND_FRAME_SIZE_MAX];
    if (!put_field(message, COMMAND_SEQUENCE, frame + UUV_HIL_FRAME_COMMAND_SEQUENCE, 2)
        || !put_pulses(pulses, count, frame + UUV_HIL_FRAME_COMMAND_PWM_US))
        Py_RETURN_NONE;
    frame[UUV_HIL_FRAME_COMMAND_FLAGS] = is_true(message, COMMAND_ARMED) ? UUV_HIL_FRAME_COMMAND_ARMED : 0;
    frame[UUV_HIL_FRAME_COMMAND_COUNT] = (uint8_t)count;
    return finish(frame, UUV_HIL_FRAME_COMMAND_ID, UUV_HIL_FRAME_COMMAND_FRAME_SIZE((size_t)count));
}

static PyObject *pack_telemetry(PyObject *message, PyObject *pulses, Py_ssize_t count)
{
    uint8_t frame[UUV_HIL_FRAME_TELEMETRY_FRAME_SIZE_MAX];
    if (!put_field(message, SEQUENCE, frame + UUV_HIL_FRAME_TELEMETRY_SEQUENCE, 2)
        || !put_field(message, AGE_US, frame + UUV_HIL_FRAME_TELEMETRY_AGE_US, 4)
        || !put_field(message, FRAMES, frame + UUV_HIL_FRAME_TELEMETRY_FRAMES, 2)
        || !put_field(message, ERRORS, frame + UUV_HIL_FRAME_TELEMETRY_ERRORS, 2)
        || !put_field(message, WATCHDOG_TRIPS, frame + UUV_HIL_FRAME_TELEMETRY_WATCHDOG_TRIPS, 2)
        || !put_pulses(pulses, count, frame + UUV_HIL_FRAME_TELEMETRY_PWM_US))
        Py_RETURN_NONE;
    frame[UUV_HIL_FRAME_TELEMETRY_FLAGS] = (uint8_t)((is_true(message, ARMED) ? UUV_HIL_FRAME_TELEMETRY_ARMED : 0u)
        | (is_true(message, TIMED_OUT) ? UUV_HIL_FRAME_TELEMETRY_TIMED_OUT : 0u));
    frame[UUV_HIL_FRAME_TELEMETRY_COUNT] = (uint8_t)count;
    return finish(frame, UUV_HIL_FRAME_TELEMETRY_ID, UUV_HIL_FRAME_TELEMETRY_FRAME_SIZE((size_t)count));
}

static PyObject *pack(PyObject *module, PyObject *message)
{
    (void)module;
    PyTypeObject *type = Py_TYPE(message);
    if (type != command_type && type != telemetry_type)
        Py_RETURN_NONE;
    PyObject *pulses = PyTuple_GetItem(message, type == command_type ? (Py_ssize_t)COMMAND_PWM_US : (Py_ssize_t)PWM_US);
    Py_ssize_t count = pulses != NULL && PyTuple_Check(pulses) ? PyTuple_Size(pulses) : 0;
    if (count < 1 || count > MOST)
        Py_RETURN_NONE;
    return (type == command_type ? pack_command : pack_telemetry)(message, pulses, count);
}

static PyObject *pulses_at(const uint8_t *from, int count)
{
    long pulses[MOST];
    for (int i = 0; i < count; i++)
        pulses[i] = (long)get(from + 2 * i, 2);
    return new_whole_tuple(pulses, count);
}

static PyObject *read_command(const uint8_t *frame, int count)
{
    PyObject *armed = frame[UUV_HIL_FRAME_COMMAND_FLAGS] & UUV_HIL_FRAME_COMMAND_ARMED ? Py_True : Py_False;
    return new_record(command_type, Py_BuildValue("ION",
        (unsigned)get(frame + UUV_HIL_FRAME_COMMAND_SEQUENCE, 2), armed,
        pulses_at(frame + UUV_HIL_FRAME_COMMAND_PWM_US, count)));
}

static PyObject *read_telemetry(const uint8_t *frame, int count)
{
    uint8_t flags = frame[UUV_HIL_FRAME_TELEMETRY_FLAGS];
    return new_record(telemetry_type, Py_BuildValue("IOONIIII",
        (unsigned)get(frame + UUV_HIL_FRAME_TELEMETRY_SEQUENCE, 2),
        flags & UUV_HIL_FRAME_TELEMETRY_ARMED ? Py_True : Py_False,
        flags & UUV_HIL_FRAME_TELEMETRY_TIMED_OUT ? Py_True : Py_False,
        pulses_at(frame + UUV_HIL_FRAME_TELEMETRY_PWM_US, count),
        (unsigned)get(frame + UUV_HIL_FRAME_TELEMETRY_AGE_US, 4),
        (unsigned)get(frame + UUV_HIL_FRAME_TELEMETRY_FRAMES, 2),
        (unsigned)get(frame + UUV_HIL_FRAME_TELEMETRY_ERRORS, 2),
        (unsigned)get(frame + UUV_HIL_FRAME_TELEMETRY_WATCHDOG_TRIPS, 2)));
}

static PyObject *read_frame(PyObject *module, PyObject *data)
{
    char *bytes;
    Py_ssize_t size;
    (void)module;
    if (PyBytes_AsStringAndSize(data, &bytes, &size) < 0)
        return NULL;
    const uint8_t *frame = (const uint8_t *)bytes;
    /* What a frame of either kind has: its count stands at the same place in both. */
    if (size < (Py_ssize_t)UUV_HIL_FRAME_COMMAND_FRAME_SIZE(1) || frame[0] != UUV_HIL_FRAME_SYNC_0
        || frame[1] != UUV_HIL_FRAME_SYNC_1
        || size != (Py_ssize_t)(UUV_HIL_FRAME_PAYLOAD + frame[UUV_HIL_FRAME_LENGTH] + UUV_HIL_FRAME_CRC_SIZE))
        Py_RETURN_NONE;
    unsigned count = frame[UUV_HIL_FRAME_COMMAND_COUNT], id = frame[UUV_HIL_FRAME_ID];
    size_t whole = id == UUV_HIL_FRAME_COMMAND_ID ? UUV_HIL_FRAME_COMMAND_FRAME_SIZE((size_t)count)
        : id == UUV_HIL_FRAME_TELEMETRY_ID ? UUV_HIL_FRAME_TELEMETRY_FRAME_SIZE((size_t)count) : 0;
    size_t end = (size_t)size - UUV_HIL_FRAME_CRC_SIZE;
    if (count < 1 || count > MOST || whole != (size_t)size || get(frame + end, 2) != crc_of(frame, end))
        Py_RETURN_NONE;
    return (id == UUV_HIL_FRAME_COMMAND_ID ? read_command : read_telemetry)(frame, (int)count);
}

_Static_assert(UUV_HIL_FRAME_COMMAND_COUNT == UUV_HIL_FRAME_TELEMETRY_COUNT, "read_frame looks for it in one place");

static PyMethodDef methods[] = {
    {"pack", pack, METH_O, "pack(message): its frame, or None."},
    {"read", read_frame, METH_O, "read(data): the message whose frame these bytes are, or None."},
    {NULL, NULL, 0, NULL},
};

static int module_exec(PyObject *module)
{
    (void)module;
    PyObject *contract = PyImport_ImportModule("hil.links.contract");
    if (contract == NULL)
        return -1;
    command_type = (PyTypeObject *)PyObject_GetAttrString(contract, "ThrusterCommand");
    telemetry_type = (PyTypeObject *)PyObject_GetAttrString(contract, "ThrusterTelemetry");
    Py_DECREF(contract);
    return command_type == NULL || telemetry_type == NULL ? -1 : 0;
}

static PyModuleDef_Slot module_slots[] = {{Py_mod_exec, module_exec}, {0, NULL}};

static PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "hil.slave.native._frame", "Frames in C.", 0, methods, module_slots, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__frame(void)
{
    return PyModuleDef_Init(&module);
}
