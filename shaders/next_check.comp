// Runs after each recorded check for divergence (divergence_check.comp), so that the next check has the next
// number.
layout(local_size_x = 1) in;

layout(std430, binding = 3) restrict buffer Found {
    uint found;
    uint next_check;
};

void main() { ++next_check; }
