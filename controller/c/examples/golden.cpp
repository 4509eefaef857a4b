// Loads a policy file and reproduces its golden steps: golden POLICY.omni. Exit code 0 if it does.
//
//     c++ -std=c++17 golden.cpp -I. -L. -lomniwalk_c -Wl,-rpath,. -o golden
//
// -rpath is where the library is looked for when the program runs; without it LD_LIBRARY_PATH says so.
#include <cmath>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "omniwalk.h"

namespace {

// Largest difference from a golden number x, relative to 1 + |x|: instruction sets round differently.
constexpr float tolerance = 1e-4f;

struct Free {
    void operator()(OwController *controller) const { ow_free(controller); }
};
using Controller = std::unique_ptr<OwController, Free>;

void check(OwResult result) {
    if (result != OW_RESULT_OK) {
        throw std::runtime_error(ow_message());
    }
}

Controller load(const std::string &path) {
    OwController *controller = nullptr;
    check(ow_load_file(path.c_str(), &controller));
    return Controller(controller);
}

std::vector<std::string> joint_names(const Controller &controller) {
    std::vector<std::string> names;
    for (size_t i = 0; i < ow_joints(controller.get()); ++i) {
        char name[256];
        check(ow_joint_name(controller.get(), i, name, sizeof name));
        names.emplace_back(name);
    }
    return names;
}

// A robot that declares its joints in another order is refused; by name it finds them.
void check_wiring(const Controller &controller) {
    std::vector<std::string> names = joint_names(controller);
    std::swap(names.front(), names.back());
    std::vector<const char *> order;
    for (const auto &name : names) {
        order.push_back(name.c_str());
    }
    if (ow_check_joints(controller.get(), order.data(), order.size()) != OW_RESULT_MISFIT) {
        throw std::runtime_error("another order of the joints was not refused");
    }
    std::cout << "refused: " << ow_message() << "\n";
    std::vector<size_t> map(names.size());
    check(ow_joint_map(controller.get(), order.data(), order.size(), map.data()));
    if (map.front() != names.size() - 1) {
        throw std::runtime_error("the mapping is wrong");
    }
}

void reproduce(const Controller &controller) {
    const size_t joints = ow_joints(controller.get());
    std::vector<float> targets(joints);
    check(ow_reset(controller.get(), ow_golden_phase(controller.get())));
    for (size_t step = 0; step < ow_golden_steps(controller.get()); ++step) {
        OwReadings readings;
        OwStatus status;
        float desired[3];
        const float *expected = nullptr;
        check(ow_golden_step(controller.get(), step, &readings, desired, &expected));
        readings.measured = step * ow_period(controller.get());
        check(ow_step(controller.get(), readings.measured, &readings, desired, targets.data(), joints, &status));
        for (size_t joint = 0; joint < joints; ++joint) {
            const float miss = std::fabs(targets[joint] - expected[joint]);
            if (!(miss <= tolerance * (1.0f + std::fabs(expected[joint])))) {
                throw std::runtime_error("step " + std::to_string(step) + ", joint " + std::to_string(joint));
            }
        }
    }
    std::cout << "reproduced " << ow_golden_steps(controller.get()) << " golden steps\n";
}

}  // namespace

int main(int arguments, char **argument) {
    if (arguments != 2) {
        std::cerr << "usage: " << argument[0] << " POLICY.omni\n";
        return 2;
    }
    try {
        const Controller controller = load(argument[1]);
        check_wiring(controller);
        reproduce(controller);
    } catch (const std::exception &error) {
        std::cerr << error.what() << "\n";
        return 1;
    }
    return 0;
}
