// Makes a rest length from its square by inverse_root(), as a step does with lengths of springs.
#include "inverse_root.h"

#ifdef VOXSPRING_FLOAT64
const Real min_normal = 2.2250738585072014e-308lf;
#else
const Real min_normal = 1.17549435e-38;
#endif

// inverse_root() is for normal numbers only, and slots without a spring have 0.
Real measured_or_zero(Real squared) { return squared >= min_normal ? measured_length(squared) : Real(0); }
