/* Refuse to compile where double expressions are not computed as doubles in the order written: the twins need this.
 *
 * FLT_EVAL_METHOD says in which format an expression is computed (C11 5.2.4.2.2; ISO/IEC TS 18661-3 5.3, C23). A double
 * stays a double with 0 (each type as itself), 1 (float as double), and the formats that are no wider than double:
 * 16 (_Float16, on processors with half-precision arithmetic), 32 (_Float32), 33 (_Float32x) and 64 (_Float64). It does
 * not with 2 (as long double), 65, 128 and 129, and nothing is known with a negative value. With 1, 33 and 64 a float
 * is computed as a double, and the rays work on floats: they only load, compare and store them, which is the same.
 */

#ifndef UUV_HIL_CHECK_DOUBLES_H
#define UUV_HIL_CHECK_DOUBLES_H

#include <float.h>

#if FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 1 && FLT_EVAL_METHOD != 16 && FLT_EVAL_METHOD != 32 \
    && FLT_EVAL_METHOD != 33 && FLT_EVAL_METHOD != 64
#error "doubles must be computed as doubles: compile without -mfpmath=387 and the like"
#endif
#ifdef __FAST_MATH__
#error "doubles must be computed in the order written: compile without -ffast-math"
#endif

#endif
