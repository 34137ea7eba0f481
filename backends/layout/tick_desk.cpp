#include "backends/layout/tick_desk.h"

#include <algorithm>
#include <array>

namespace voxspring::layout {

void TickDesk::open(OrderWords* asked, std::span<AnswerWords> answers) {
    asked_ = asked;
    answers_ = answers;
    forces_.assign(answers.size(), {});
    arrived_ = answers.size();
    // New memory may hold any numbers. All words get the number of the latest tick, which is over, so that
    // none is taken for a future order or answer.
    const std::uint64_t old = tick_word(0U, order_.tick);
    std::fill(std::begin(asked_->word), std::end(asked_->word), old);
    for (AnswerWords& answer : answers_) std::fill(std::begin(answer.word), std::end(answer.word), old);
}

void TickDesk::order(Vector<float> moved, std::uint32_t steps) {
    order_ = {moved, steps, order_.tick + 1};
    arrived_ = 0;
    write();
}

void TickDesk::order_again() { order(order_.moved, order_.steps); }

void TickDesk::order_end() {
    order_.steps = 0;
    ++order_.tick;
    write();
}

void TickDesk::write() {
    const std::array<std::uint64_t, 4> words = {
        tick_word(order_.moved.x, order_.tick), tick_word(order_.moved.y, order_.tick),
        tick_word(order_.moved.z, order_.tick), tick_word(order_.steps, order_.tick)};
    for (std::size_t n = 0; n < words.size(); ++n)
        __atomic_store_n(asked_->word + n, words[n], __ATOMIC_RELAXED);
}

bool TickDesk::answered() {
    for (; arrived_ < answers_.size(); ++arrived_) {
        std::array<std::uint64_t, 3> words{};
        for (std::size_t n = 0; n < words.size(); ++n) {
            words[n] = __atomic_load_n(answers_[arrived_].word + n, __ATOMIC_RELAXED);
            if (tick_of(words[n]) != order_.tick) return false;
        }
        forces_[arrived_] = {{real_in(words[0]), real_in(words[1]), real_in(words[2])}};
    }
    return true;
}

}  // namespace voxspring::layout
