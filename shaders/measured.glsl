// A rest length as inverse_root() measures lengths, from its square.
#include "inverse_root.h"

// inverse_root() is for normal numbers, and 0 is no spring.
float measured_or_zero(float squared) { return squared >= 1.17549435e-38 ? measured_length(squared) : 0.0; }
