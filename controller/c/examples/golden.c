/* Loads a policy file and reproduces its golden steps: golden POLICY.omni. Exit code 0 if it does.
 *
 *     cc golden.c -I. libomniwalk_c.a -lpthread -ldl -lm -o golden
 *
 * For a machine without files, with the policy in the program (`omniwalk export --c DIR` writes policy.h and policy.c):
 *
 *     cc -DPOLICY_INSIDE golden.c policy.c -I. libomniwalk_c.a -lpthread -ldl -lm -o golden
 */
#include <math.h>
#include <stdio.h>

#include "omniwalk.h"
#ifdef POLICY_INSIDE
#include "policy.h"
#endif

/* Largest difference from a golden number x, relative to 1 + |x|: instruction sets round differently. */
#define TOLERANCE 1e-4f
#define MOST_JOINTS 256

static int complain(const char *what) {
    fprintf(stderr, "%s: %s\n", what, ow_message());
    return 2;
}

#ifdef POLICY_INSIDE
static OwResult load(int arguments, char **argument, OwController **controller) {
    (void)arguments;
    (void)argument;
    return ow_load(omniwalk_policy, omniwalk_policy_size, controller);
}
#else
static OwResult load(int arguments, char **argument, OwController **controller) {
    (void)arguments;
    return ow_load_file(argument[1], controller);
}
#endif

int main(int arguments, char **argument) {
    OwController *controller = NULL;
    float targets[MOST_JOINTS];
    size_t step, joint, joints;
#ifndef POLICY_INSIDE
    if (arguments != 2) {
        fprintf(stderr, "usage: %s POLICY.omni\n", argument[0]);
        return 2;
    }
#endif
    if (load(arguments, argument, &controller) != OW_RESULT_OK) {
        return complain("cannot load");
    }
    joints = ow_joints(controller);
    if (joints > MOST_JOINTS || ow_reset(controller, ow_golden_phase(controller)) != OW_RESULT_OK) {
        return complain("cannot reset");
    }
    for (step = 0; step < ow_golden_steps(controller); step++) {
        OwReadings readings;
        OwStatus status;
        float desired[3];
        const float *expected;
        uint64_t now = (uint64_t)step * ow_period(controller);
        if (ow_golden_step(controller, step, &readings, desired, &expected) != OW_RESULT_OK) {
            return complain("no golden step");
        }
        readings.measured = now;
        if (ow_step(controller, now, &readings, desired, targets, joints, &status) != OW_RESULT_OK) {
            return complain("no step");
        }
        if (status.fault != OW_FAULT_NONE) {
            char text[256];
            ow_status_message(controller, text, sizeof text);
            fprintf(stderr, "step %d: %s\n", (int)step, text);
            return 1;
        }
        for (joint = 0; joint < joints; joint++) {
            /* Written so that a number that is none does not pass. */
            if (!(fabsf(targets[joint] - expected[joint]) <= TOLERANCE * (1.0f + fabsf(expected[joint])))) {
                fprintf(stderr, "step %d, joint %d: %g instead of %g\n", (int)step, (int)joint, targets[joint],
                        expected[joint]);
                return 1;
            }
        }
    }
    printf("reproduced %d golden steps of %d joints\n", (int)step, (int)joints);
    ow_free(controller);
    return 0;
}
