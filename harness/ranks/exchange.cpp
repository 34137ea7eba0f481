#include "harness/ranks/exchange.h"

namespace voxspring {

void greet(Exchange& exchange, const std::vector<int>& others) {
    for (const int other : others) {
        (void)exchange.outbox(other, 0);
        exchange.post(other);
    }
    for (const int other : others) {
        (void)exchange.inbox(other);
        exchange.release(other);
    }
}

// After n rounds a rank has heard, through the ranks between, from all ranks up to n away.
void meet(Exchange& exchange) {
    std::vector<int> beside;
    for (const int other : {exchange.rank() - 1, exchange.rank() + 1}) {
        if (other >= 0 && other < exchange.ranks()) beside.push_back(other);
    }
    for (int round = 1; round < exchange.ranks(); ++round) greet(exchange, beside);
}

}  // namespace voxspring
