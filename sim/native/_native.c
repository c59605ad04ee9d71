/* Shows kernel.h, forces.h, waves.h, errors.h and impulses.h to Python: the module sim.native._native. */

#include "moving.h"

#include "fused.h"
#include "measuring.h"
#include "impulses.h"

static int module_exec(PyObject *module)
{
    return add_pushing(module) && add_moving(module) && add_fused(module) && add_measuring(module)
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
