// A race that ThreadSanitizer must find, in threads as the CPU backends have them: the preset `threads`
// expects this program to fail.
#include <cstdio>

int main() {
    int sum = 0;
#pragma omp parallel for num_threads(3)
    for (int n = 0; n < 1000; ++n) sum += n;
    std::printf("%d\n", sum);
}
