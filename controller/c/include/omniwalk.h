/* The controller of omniwalk for C and C++. Made from controller/c/src by cbindgen; do not edit. */

#ifndef OMNIWALK_H
#define OMNIWALK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/**
 * What became of a call. `ow_message` says more of whatever is not OK.
 */
typedef enum OwResult {
  /**
   * It was done.
   */
  OW_RESULT_OK = 0,
  /**
   * A pointer is null, a length is not the policy's, or a text is not UTF-8.
   */
  OW_RESULT_ARGUMENT = 1,
  /**
   * The file cannot be read.
   */
  OW_RESULT_IO = 2,
  /**
   * The bytes are no policy, or not one that this program runs as it was trained.
   */
  OW_RESULT_POLICY = 3,
  /**
   * The policy does not fit the robot.
   */
  OW_RESULT_MISFIT = 4,
  /**
   * A mistake in the controller itself; do not use it any more.
   */
  OW_RESULT_INTERNAL = 5,
  /**
   * Readings that cannot be believed.
   */
  OW_RESULT_READINGS = 6,
} OwResult;

/**
 * What the controller is doing.
 */
typedef enum OwMode {
  /**
   * The policy moves the joints.
   */
  OW_MODE_WALKING = 0,
  /**
   * The last targets are held.
   */
  OW_MODE_HOLDING = 1,
  /**
   * The targets move to the nominal pose.
   */
  OW_MODE_RAMPING = 2,
  /**
   * The targets are the nominal pose.
   */
  OW_MODE_RESTING = 3,
} OwMode;

/**
 * Why the policy does not move the joints in a step.
 */
typedef enum OwFault {
  /**
   * It does.
   */
  OW_FAULT_NONE = 0,
  /**
   * The newest reading is too old, or from the future.
   */
  OW_FAULT_STALE = 1,
  /**
   * A reading is not a finite number.
   */
  OW_FAULT_NOT_FINITE = 2,
  /**
   * The base tilts, or has tilted since the last reset, beyond what training allowed.
   */
  OW_FAULT_FALLEN = 3,
  /**
   * The step came sooner than the control rate allows: nothing was done.
   */
  OW_FAULT_OVER_RATE = 4,
  /**
   * A reading is one that no working sensor gives: a position beyond the joint's limits by more than a tenth of its range and
   * 0.02 rad or m, an angle of the base beyond half a turn, or a rate beyond 1000 rad/s or m/s.
   */
  OW_FAULT_ABSURD = 5,
} OwFault;

/**
 * Which reading a fault is about.
 */
typedef enum OwReading {
  /**
   * None alone.
   */
  OW_READING_NONE = 0,
  /**
   * Position of a joint.
   */
  OW_READING_POSITION = 1,
  /**
   * Velocity of a joint.
   */
  OW_READING_VELOCITY = 2,
  /**
   * Fused roll or pitch of the base.
   */
  OW_READING_ATTITUDE = 3,
  /**
   * An axis of the angular velocity of the base.
   */
  OW_READING_GYRO = 4,
  /**
   * An axis of the velocity of the base.
   */
  OW_READING_BASE_VELOCITY = 5,
} OwReading;

/**
 * What became of the desired velocity.
 */
typedef enum OwCommand {
  /**
   * Taken as it is.
   */
  OW_COMMAND_TAKEN = 0,
  /**
   * Clipped to the range that was trained.
   */
  OW_COMMAND_CLIPPED = 1,
  /**
   * Not a number: its axis stayed what it was.
   */
  OW_COMMAND_NOT_FINITE = 2,
} OwCommand;

/**
 * A policy in its loop. One thread at a time.
 */
typedef struct OwController OwController;

/**
 * A joint of the policy, as it was trained; the robot's must be the same.
 */
typedef struct OwJoint {
  /**
   * Position in the nominal pose, rad or m.
   */
  float nominal;
  /**
   * Lower position limit, rad or m.
   */
  float lower;
  /**
   * Upper position limit, rad or m.
   */
  float upper;
  /**
   * Position gain, N m/rad or N/m.
   */
  float kp;
  /**
   * Velocity gain, N m s/rad or N s/m.
   */
  float kd;
  /**
   * Torque limit, N m or N.
   */
  float torque_limit;
} OwJoint;

/**
 * Readings of one control step.
 */
typedef struct OwReadings {
  /**
   * When they were measured, ns on the clock of `ow_step`'s `now`.
   */
  uint64_t measured;
  /**
   * Positions of the policy's joints in its order, rad or m.
   */
  const float *position;
  /**
   * Velocities of the policy's joints in its order, rad/s or m/s.
   */
  const float *velocity;
  /**
   * Fused roll and pitch of the base, rad.
   */
  float attitude[2];
  /**
   * Angular velocity of the base in the base frame, rad/s.
   */
  float gyro[3];
  /**
   * Velocity of the base origin in the base frame, m/s, if `has_base_velocity`; otherwise it is estimated from the legs.
   */
  float base_velocity[3];
  /**
   * Whether `base_velocity` is given.
   */
  bool has_base_velocity;
} OwReadings;

/**
 * What a step says beside its targets.
 */
typedef struct OwStatus {
  /**
   * What the targets are.
   */
  enum OwMode mode;
  /**
   * What kept the policy from this step.
   */
  enum OwFault fault;
  /**
   * Age of a stale reading, s; negative from the future.
   */
  float stale_age;
  /**
   * Which reading is not finite or absurd.
   */
  enum OwReading reading;
  /**
   * Index of its joint or axis, or -1.
   */
  int32_t reading_index;
  /**
   * What became of the desired velocity.
   */
  enum OwCommand command;
  /**
   * Entry of the observation farthest beyond what training saw, or -1; `ow_entry_name` names it.
   */
  int32_t out_of_range_entry;
  /**
   * Its value before it was clipped.
   */
  float out_of_range_value;
  /**
   * By how much it was beyond.
   */
  float out_of_range_excess;
  /**
   * How many entries were beyond.
   */
  uint32_t out_of_range_entries;
  /**
   * How much later than due the step came, s; 0 if within half a period.
   */
  float late;
} OwStatus;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Why the last call of this thread was not done; empty before the first. Valid until the next call of this thread.
 */
const char *ow_message(void);

/**
 * Loads a policy file of `size` bytes and sets `*controller`, to be given back by `ow_free`. The file is checked and
 * reproduces its golden vectors, or is refused and `*controller` is null.
 *
 * # Safety
 * `bytes` points to `size` bytes, `controller` to a place for a pointer.
 */
enum OwResult ow_load(const uint8_t *bytes,
                      size_t size,
                      struct OwController **controller);

/**
 * Loads the policy file at `path`, see `ow_load`.
 *
 * # Safety
 * `path` is a C string, `controller` points to a place for a pointer.
 */
enum OwResult ow_load_file(const char *path, struct OwController **controller);

/**
 * Gives a controller back; null is allowed.
 *
 * # Safety
 * `controller` is null or of `ow_load`, and is not used any more.
 */
void ow_free(struct OwController *controller);

/**
 * Number of the policy's joints; 0 for null.
 *
 * # Safety
 * `controller` is null or of `ow_load`.
 */
size_t ow_joints(const struct OwController *controller);

/**
 * Control period, ns; 0 for null.
 *
 * # Safety
 * `controller` is null or of `ow_load`.
 */
uint64_t ow_period(const struct OwController *controller);

/**
 * Sets `*joint` to what the policy was trained with at joint `index`.
 *
 * # Safety
 * `controller` is of `ow_load`, `joint` points to an `OwJoint`.
 */
enum OwResult ow_joint(const struct OwController *controller, size_t index, struct OwJoint *joint);

/**
 * Writes the name of joint `index` into `buffer` of `size` bytes, cut off where it does not fit, always with a zero at
 * the end.
 *
 * # Safety
 * `controller` is of `ow_load`, `buffer` points to `size` bytes.
 */
enum OwResult ow_joint_name(const struct OwController *controller,
                            size_t index,
                            char *buffer,
                            size_t size);

/**
 * Writes the name of entry `index` of the observation into `buffer`, as `ow_joint_name` does.
 *
 * # Safety
 * `controller` is of `ow_load`, `buffer` points to `size` bytes.
 */
enum OwResult ow_entry_name(const struct OwController *controller,
                            size_t index,
                            char *buffer,
                            size_t size);

/**
 * Checks that the `count` names, the order in which you give readings and take targets, are the policy's. If not, `ow_message`
 * names the first joint that is elsewhere.
 *
 * # Safety
 * `controller` is of `ow_load`, `names` points to `count` C strings.
 */
enum OwResult ow_check_joints(const struct OwController *controller,
                              const char *const *names,
                              size_t count);

/**
 * Sets `map[i]` to the index among the `count` names, your robot's joints, of the policy's joint i. The robot may have more
 * joints than the policy.
 *
 * # Safety
 * `controller` is of `ow_load`, `names` points to `count` C strings, `map` to `ow_joints` places.
 */
enum OwResult ow_joint_map(const struct OwController *controller,
                           const char *const *names,
                           size_t count,
                           size_t *map);

/**
 * Starts an episode with the clock at `phase`, in cycles, or where the policy begins if that is not a number. The robot
 * should stand in the nominal pose.
 *
 * # Safety
 * `controller` is of `ow_load`.
 */
enum OwResult ow_reset(struct OwController *controller,
                       float phase);

/**
 * Starts with a robot in whatever pose, its `count` joints at `position`: ramps to the nominal pose, rests, then walks.
 *
 * `OW_RESULT_READINGS` if a position is not finite or well beyond its joint's limits; `ow_message` names the joint. Then do not
 * send targets to servos that are on: nothing is known to ramp from, and steps hold what was told last, with the fault, until
 * one of them has good readings, from which the takeover begins.
 *
 * # Safety
 * `controller` is of `ow_load`, `position` points to `count` numbers.
 */
enum OwResult ow_take_over(struct OwController *controller,
                           const float *position,
                           size_t count);

/**
 * One step, once a control period: sets the `count` targets, rad or m, finite and within limits, and `*status`.
 *
 * `now` is the time of the step, ns on a clock that does not jump. `desired` is the desired velocity, forward and left in
 * m/s, turn in rad/s. `count` must be `ow_joints`. Allocates nothing.
 *
 * # Safety
 * `controller` is of `ow_load`; `readings` points to readings whose arrays have `ow_joints` numbers; `desired` points
 * to three numbers, `targets` to `count` places, `status` to an `OwStatus`, or is null.
 */
enum OwResult ow_step(struct OwController *controller,
                      uint64_t now,
                      const struct OwReadings *readings,
                      const float *desired,
                      float *targets,
                      size_t count,
                      struct OwStatus *status);

/**
 * Writes what is not as it should be in the status of the last `ow_step` into `buffer`, in words and with the names of joints,
 * as `ow_joint_name` does; an empty text if all is. Allocates nothing unless a reading is beyond training.
 *
 * # Safety
 * `controller` is of `ow_load`, `buffer` points to `size` bytes.
 */
enum OwResult ow_status_message(const struct OwController *controller,
                                char *buffer,
                                size_t size);

/**
 * Number of golden steps: readings and targets by which a policy is checked where it runs; 0 for null.
 *
 * # Safety
 * `controller` is null or of `ow_load`.
 */
size_t ow_golden_steps(const struct OwController *controller);

/**
 * Phase of the reset before the golden steps; 0 for null.
 *
 * # Safety
 * `controller` is null or of `ow_load`.
 */
float ow_golden_phase(const struct OwController *controller);

/**
 * Sets readings (with `measured` at 0), desired velocity and expected targets of golden step `index`; the arrays are the
 * controller's and live as long as it does.
 *
 * # Safety
 * `controller` is of `ow_load`; `readings` points to an `OwReadings`, `desired` to three places, `targets` to a place for a
 * pointer.
 */
enum OwResult ow_golden_step(const struct OwController *controller,
                             size_t index,
                             struct OwReadings *readings,
                             float *desired,
                             const float **targets);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* OMNIWALK_H */
