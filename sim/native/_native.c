/* The Python module sim.native._native: kernel.h, forces.h, waves.h, errors.h and impulses.h for Python. */

#include "step_types.h"

#include "fused.h"
#include "sensor_types.h"
#include "impulses.h"

static int module_exec(PyObject *module)
{
    return add_force_types(module) && add_step_types(module) && add_fused(module) && add_sensor_types(module)
            && add_impulses(module) ? 0 : -1;
}

static PyModuleDef_Slot module_slots[] = {{Py_mod_exec, module_exec}, {0, NULL}};

static PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "sim.native._native", "The step in C. " SOURCE_BYTES, 0, NULL, module_slots, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__native(void)
{
    return PyModuleDef_Init(&module);
}
