#include "harness/ranks/exchange.h"

namespace voxspring {

void greet(Exchange& exchange) {
    const int rank = exchange.rank();
    for (const int other : {rank - 1, rank + 1}) {
        if (other < 0 || other >= exchange.ranks()) continue;
        (void)exchange.outbox(other, 0);
        exchange.post(other);
    }
    for (const int other : {rank - 1, rank + 1}) {
        if (other < 0 || other >= exchange.ranks()) continue;
        (void)exchange.inbox(other);
        exchange.release(other);
    }
}

// After n rounds a rank has heard, by way of others, of all that are n ranks away.
void meet(Exchange& exchange) {
    for (int round = 1; round < exchange.ranks(); ++round) greet(exchange);
}

}  // namespace voxspring
