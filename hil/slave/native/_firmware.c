/* Python extension around the firmware's core (firmware_stub/src): hil.slave.native._firmware.Firmware. */

#include "../../../sim/native/numbers.h"

#include "uuv_hil_stm32.h"

#include <time.h>

enum { NS_PER_US = 1000 };

typedef struct {
    PyObject_HEAD
    UuvHilFirmware firmware;
    UuvHilPlatform platform;
    uint64_t now_us;
    uint16_t executed_frames; /* the firmware's count of command frames when a command last set its outputs */
    long long executed_ns;
    PyObject *written; /* list of the byte strings that the firmware writes; NULL outside of service() */
} Firmware;

static uint64_t now_us(void *context)
{
    return ((Firmware *)context)->now_us;
}

static void uart_write(void *context, const uint8_t *data, size_t size)
{
    PyObject *written = ((Firmware *)context)->written;
    PyObject *report = PyBytes_FromStringAndSize((const char *)data, (Py_ssize_t)size);
    if (written != NULL && report != NULL)
        PyList_Append(written, report);
    Py_XDECREF(report);
}

static void can_write(void *context, const UuvHilCanFrame *frame)
{
    (void)context, (void)frame;
}

static void pwm_set(void *context, const uint16_t *pulse_us, uint8_t channels)
{
    Firmware *self = context;
    (void)pulse_us, (void)channels;
    if (self->firmware.board.frames == self->executed_frames)
        return;
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    self->executed_frames = self->firmware.board.frames;
    self->executed_ns = now.tv_sec * 1000000000LL + now.tv_nsec;
}

static void watchdog_kick(void *context)
{
    (void)context;
}

static PyObject *firmware_new(PyTypeObject *type, PyObject *arguments, PyObject *keywords)
{
    unsigned channels, watchdog_us;
    (void)keywords;
    if (!PyArg_ParseTuple(arguments, "II", &channels, &watchdog_us))
        return NULL;
    if (channels < 1 || channels > UUV_HIL_MAX_CHANNELS)
        return PyErr_Format(PyExc_ValueError, "1 to %u channels are needed, found %u", UUV_HIL_MAX_CHANNELS, channels);
    PyObject *object = PyType_GenericAlloc(type, 0);
    if (object == NULL)
        return NULL;
    Firmware *self = (Firmware *)object;
    self->platform = (UuvHilPlatform){self, now_us, uart_write, can_write, pwm_set, watchdog_kick};
    uuv_hil_start(&self->firmware, &self->platform, (uint8_t)channels, watchdog_us);
    return object;
}

static PyObject *firmware_service(PyObject *object, PyObject *const *arguments, Py_ssize_t count)
{
    Firmware *self = (Firmware *)object;
    char *data;
    Py_ssize_t size;
    if (count != 2)
        return PyErr_Format(PyExc_TypeError, "service() takes data and now_ns");
    if (PyBytes_AsStringAndSize(arguments[0], &data, &size) < 0)
        return NULL;
    long long now_ns = PyLong_AsLongLong(arguments[1]);
    if (now_ns == -1 && PyErr_Occurred())
        return NULL;
    self->now_us = (uint64_t)now_ns / NS_PER_US;
    PyObject *written = self->written = PyList_New(0);
    uuv_hil_service(&self->firmware, (const uint8_t *)data, (size_t)size);
    self->written = NULL;
    if (PyErr_Occurred())
        Py_CLEAR(written);
    return written;
}

static PyObject *firmware_stop(PyObject *self, PyObject *nothing)
{
    (void)nothing;
    uuv_hil_stop(&((Firmware *)self)->firmware);
    Py_RETURN_NONE;
}

static PyObject *firmware_pwm_us(PyObject *self, void *closure)
{
    const UuvHilBoard *board = &((Firmware *)self)->firmware.board;
    (void)closure;
    long pulses[UUV_HIL_MAX_CHANNELS];
    for (int i = 0; i < board->channels; i++)
        pulses[i] = board->pwm_us[i];
    return new_whole_tuple(pulses, board->channels);
}

static PyObject *firmware_deadline_ns(PyObject *self, void *closure)
{
    (void)closure;
    return PyLong_FromUnsignedLongLong(uuv_hil_deadline_us(&((Firmware *)self)->firmware) * NS_PER_US);
}

static PyObject *firmware_executed_ns(PyObject *self, void *closure)
{
    (void)closure;
    return PyLong_FromLongLong(((Firmware *)self)->executed_ns);
}

static PyMethodDef firmware_methods[] = {
    {"service", (PyCFunction)(void (*)(void))firmware_service, METH_FASTCALL,
     "service(data, now_ns): process received data, advance the time to now_ns; return the list of bytes written."},
    {"stop", firmware_stop, METH_NOARGS, "stop(): set the outputs to neutral; call it before the end."},
    {NULL, NULL, 0, NULL},
};

static PyGetSetDef firmware_attributes[] = {
    {"pwm_us", firmware_pwm_us, NULL, "pulse widths in effect, us", NULL},
    {"deadline_ns", firmware_deadline_ns, NULL, "time of the next call of service that is due without new data", NULL},
    {"executed_ns", firmware_executed_ns, NULL, "time (monotonic) when a command last set the outputs; 0: never", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot firmware_slots[] = {
    {Py_tp_doc, "The firmware, powered up: Firmware(channels, watchdog_us)."},
    {Py_tp_new, firmware_new},
    {Py_tp_dealloc, deallocate},
    {Py_tp_methods, firmware_methods},
    {Py_tp_getset, firmware_attributes},
    {0, NULL},
};

static PyType_Spec firmware_spec = {
    "hil.slave.native._firmware.Firmware", sizeof(Firmware), 0, Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
    firmware_slots,
};

static int module_exec(PyObject *module)
{
    return add_type(module, &firmware_spec, "Firmware") ? 0 : -1;
}

static PyModuleDef_Slot module_slots[] = {{Py_mod_exec, module_exec}, {0, NULL}};

static PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "hil.slave.native._firmware", "The STM32's firmware. " SOURCE_BYTES, 0, NULL, module_slots,
    NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__firmware(void)
{
    return PyModuleDef_Init(&module);
}
