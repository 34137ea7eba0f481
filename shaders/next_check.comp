// Runs between recorded checks (divergence_check.comp): the next check gets the next number.
layout(local_size_x = 1) in;

layout(std430, binding = 3) restrict buffer Found {
    uint found;
    uint next_check;
};

void main() { ++next_check; }
