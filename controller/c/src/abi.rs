//! The functions of the C header: what a caller in C promises is said at each function, and everything that can be checked is
//! checked. With `caller` the only `unsafe` of the crate.
#![allow(unsafe_code)]

use std::ffi::c_char;
use std::fs::File;
use std::io::Read;

use omniwalk_controller::file::MAX_LEN;
use omniwalk_controller::{Controller, JointSpec, Policy, Sensors, Status};

use crate::caller::{MESSAGE, Refused, argument, array, array_mut, given, given_mut, guarded, put, text, texts};
use crate::types::{OwJoint, OwReadings, OwResult, OwStatus};

/// A policy in its loop. One thread at a time.
pub struct OwController {
    policy: Policy,
    controller: Controller,
    /// Of the last step.
    status: Option<Status>,
}

impl OwController {
    fn joint(&self, index: usize) -> Result<&JointSpec, Refused> {
        let joint = self.policy.spec().joints.get(index);
        joint.ok_or_else(|| argument("there is no joint of this index"))
    }
}

/// Why the last call of this thread was not done; empty before the first. Valid until the next call of this thread.
#[unsafe(no_mangle)]
pub extern "C" fn ow_message() -> *const c_char {
    MESSAGE.with_borrow(|text| text.as_ptr())
}

/// Loads a policy file of `size` bytes and sets `*controller`, to be given back by `ow_free`. The file is checked and
/// reproduces its golden vectors, or is refused and `*controller` is null.
///
/// # Safety
/// `bytes` points to `size` bytes, `controller` to a place for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_load(bytes: *const u8, size: usize, controller: *mut *mut OwController) -> OwResult {
    guarded(|| {
        // SAFETY: as promised by the caller.
        let place = unsafe { given_mut(controller, "controller")? };
        *place = std::ptr::null_mut();
        // SAFETY: likewise.
        let bytes = unsafe { array(bytes, size, "bytes")? };
        *place = Box::into_raw(Box::new(load(bytes)?));
        Ok(())
    })
}

/// Loads the policy file at `path`, see `ow_load`.
///
/// # Safety
/// `path` is a C string, `controller` points to a place for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_load_file(path: *const c_char, controller: *mut *mut OwController) -> OwResult {
    guarded(|| {
        // SAFETY: as promised by the caller.
        let place = unsafe { given_mut(controller, "controller")? };
        *place = std::ptr::null_mut();
        // SAFETY: likewise.
        let path = unsafe { text(path, "path")? };
        let bytes = read(path).map_err(|error| (OwResult::Io, format!("cannot read {path}: {error}")))?;
        *place = Box::into_raw(Box::new(load(&bytes)?));
        Ok(())
    })
}

/// What is in a file, as far as a policy can reach; opening a pipe would wait for somebody to write.
fn read(path: &str) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    if !std::fs::metadata(path)?.is_file() {
        return Err(std::io::Error::other("it is not a file"));
    }
    File::open(path)?.take(MAX_LEN as u64 + 1).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn load(bytes: &[u8]) -> Result<OwController, Refused> {
    let policy = Policy::from_bytes(bytes).map_err(|error| (OwResult::Policy, error.to_string()))?;
    let controller = Controller::new(&policy).map_err(|error| (OwResult::Policy, error.to_string()))?;
    Ok(OwController {
        policy,
        controller,
        status: None,
    })
}

/// Gives a controller back; null is allowed.
///
/// # Safety
/// `controller` is null or of `ow_load`, and is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_free(controller: *mut OwController) {
    if !controller.is_null() {
        guarded(|| {
            // SAFETY: it was made by `Box::into_raw` and is given back once.
            drop(unsafe { Box::from_raw(controller) });
            Ok(())
        });
    }
}

/// Number of the policy's joints; 0 for null.
///
/// # Safety
/// `controller` is null or of `ow_load`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_joints(controller: *const OwController) -> usize {
    // SAFETY: as promised by the caller.
    unsafe { controller.as_ref() }.map_or(0, |it| it.policy.spec().action_len())
}

/// Control period, ns; 0 for null.
///
/// # Safety
/// `controller` is null or of `ow_load`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_period(controller: *const OwController) -> u64 {
    // SAFETY: as promised by the caller.
    unsafe { controller.as_ref() }.map_or(0, |it| it.controller.period())
}

/// Sets `*joint` to what the policy was trained with at joint `index`.
///
/// # Safety
/// `controller` is of `ow_load`, `joint` points to an `OwJoint`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_joint(controller: *const OwController, index: usize, joint: *mut OwJoint) -> OwResult {
    guarded(|| {
        // SAFETY: as promised by the caller.
        let (it, place) = unsafe { (given(controller, "controller")?, given_mut(joint, "joint")?) };
        let joint = it.joint(index)?;
        *place = OwJoint {
            nominal: joint.nominal,
            lower: joint.lower,
            upper: joint.upper,
            kp: joint.kp,
            kd: joint.kd,
            torque_limit: joint.torque_limit,
        };
        Ok(())
    })
}

/// Writes the name of joint `index` into `buffer` of `size` bytes, cut off where it does not fit, always with a zero at
/// the end.
///
/// # Safety
/// `controller` is of `ow_load`, `buffer` points to `size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_joint_name(
    controller: *const OwController,
    index: usize,
    buffer: *mut c_char,
    size: usize,
) -> OwResult {
    guarded(|| {
        // SAFETY: as promised by the caller.
        let it = unsafe { given(controller, "controller")? };
        let joint = it.joint(index)?;
        // SAFETY: as promised by the caller.
        unsafe { put(&joint.name, buffer, size) }
    })
}

/// Writes the name of entry `index` of the observation into `buffer`, as `ow_joint_name` does.
///
/// # Safety
/// `controller` is of `ow_load`, `buffer` points to `size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_entry_name(
    controller: *const OwController,
    index: usize,
    buffer: *mut c_char,
    size: usize,
) -> OwResult {
    guarded(|| {
        // SAFETY: as promised by the caller.
        let it = unsafe { given(controller, "controller")? };
        let name = it
            .policy
            .spec()
            .entry_name(index)
            .ok_or_else(|| argument("there is no entry of this index"))?;
        // SAFETY: as promised by the caller.
        unsafe { put(&name, buffer, size) }
    })
}

/// Checks that the `count` names, the order in which you give readings and take targets, are the policy's. If not, `ow_message`
/// names the first joint that is elsewhere.
///
/// # Safety
/// `controller` is of `ow_load`, `names` points to `count` C strings.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_check_joints(
    controller: *const OwController,
    names: *const *const c_char,
    count: usize,
) -> OwResult {
    guarded(|| {
        // SAFETY: as promised by the caller.
        let (it, names) = unsafe { (given(controller, "controller")?, texts(names, count)?) };
        let checked = it.policy.spec().check_order(&names);
        checked.map_err(|misfit| (OwResult::Misfit, misfit.to_string()))
    })
}

/// Sets `map[i]` to the index among the `count` names, your robot's joints, of the policy's joint i. The robot may have more
/// joints than the policy.
///
/// # Safety
/// `controller` is of `ow_load`, `names` points to `count` C strings, `map` to `ow_joints` places.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_joint_map(
    controller: *const OwController,
    names: *const *const c_char,
    count: usize,
    map: *mut usize,
) -> OwResult {
    guarded(|| {
        // SAFETY: as promised by the caller.
        let (it, names) = unsafe { (given(controller, "controller")?, texts(names, count)?) };
        let found = it.policy.spec().joint_map(&names);
        let found = found.map_err(|misfit| (OwResult::Misfit, misfit.to_string()))?;
        // SAFETY: as promised by the caller.
        unsafe { array_mut(map, found.len(), "map")? }.copy_from_slice(&found);
        Ok(())
    })
}

/// Starts an episode with the clock at `phase`, in cycles, or where the policy begins if that is not a number. The robot
/// should stand in the nominal pose.
///
/// # Safety
/// `controller` is of `ow_load`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_reset(controller: *mut OwController, phase: f32) -> OwResult {
    guarded(|| {
        // SAFETY: as promised by the caller.
        let it = unsafe { given_mut(controller, "controller")? };
        let own = it.controller.reset_phase();
        it.controller.reset(if phase.is_finite() { phase } else { own });
        Ok(())
    })
}

/// Starts with a robot in whatever pose, its `count` joints at `position`: ramps to the nominal pose, rests, then walks.
///
/// `OW_RESULT_READINGS` if a position is not finite or well beyond its joint's limits; `ow_message` names the joint. Then do not
/// send targets to servos that are on: nothing is known to ramp from, and steps hold what was told last, with the fault, until
/// one of them has good readings, from which the takeover begins.
///
/// # Safety
/// `controller` is of `ow_load`, `position` points to `count` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_take_over(controller: *mut OwController, position: *const f32, count: usize) -> OwResult {
    guarded(|| {
        // SAFETY: as promised by the caller.
        let (it, position) = unsafe {
            (
                given_mut(controller, "controller")?,
                array(position, count, "position")?,
            )
        };
        let joints = it.policy.spec().action_len();
        if count != joints {
            return Err((OwResult::Argument, format!("{count} positions instead of {joints}")));
        }
        let taken = it.controller.take_over(position);
        taken.map_err(|fault| (OwResult::Readings, fault.sentence(it.policy.spec())))
    })
}

/// One step, once a control period: sets the `count` targets, rad or m, finite and within limits, and `*status`.
///
/// `now` is the time of the step, ns on a clock that does not jump. `desired` is the desired velocity, forward and left in
/// m/s, turn in rad/s. `count` must be `ow_joints`. Allocates nothing.
///
/// # Safety
/// `controller` is of `ow_load`; `readings` points to readings whose arrays have `ow_joints` numbers; `desired` points
/// to three numbers, `targets` to `count` places, `status` to an `OwStatus`, or is null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_step(
    controller: *mut OwController,
    now: u64,
    readings: *const OwReadings,
    desired: *const f32,
    targets: *mut f32,
    count: usize,
    status: *mut OwStatus,
) -> OwResult {
    guarded(|| {
        // SAFETY: as promised by the caller.
        let (it, readings) = unsafe { (given_mut(controller, "controller")?, given(readings, "readings")?) };
        let joints = it.policy.spec().action_len();
        if count != joints {
            return Err((OwResult::Argument, format!("{count} targets instead of {joints}")));
        }
        // SAFETY: as promised by the caller; the targets are nobody else's.
        let (desired, position, velocity, targets) = unsafe {
            (
                array(desired, 3, "desired")?,
                array(readings.position, joints, "position")?,
                array(readings.velocity, joints, "velocity")?,
                array_mut(targets, joints, "targets")?,
            )
        };
        let sensors = Sensors {
            position,
            velocity,
            attitude: readings.attitude,
            gyro: readings.gyro,
            base_velocity: readings.has_base_velocity.then_some(readings.base_velocity),
        };
        let desired = [desired[0], desired[1], desired[2]];
        let found = it.controller.step(now, readings.measured, &sensors, desired, targets);
        it.status = Some(found);
        // SAFETY: as promised by the caller.
        if let Some(status) = unsafe { status.as_mut() } {
            *status = found.into();
        }
        Ok(())
    })
}

/// Writes what is not as it should be in the status of the last `ow_step` into `buffer`, in words and with the names of joints,
/// as `ow_joint_name` does; an empty text if all is. Allocates nothing unless a reading is beyond training.
///
/// # Safety
/// `controller` is of `ow_load`, `buffer` points to `size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_status_message(
    controller: *const OwController,
    buffer: *mut c_char,
    size: usize,
) -> OwResult {
    guarded(|| {
        // SAFETY: as promised by the caller.
        let it = unsafe { given(controller, "controller")? };
        let spec = it.policy.spec();
        // SAFETY: as promised by the caller.
        unsafe {
            match &it.status {
                Some(status) => put(status.sentence(spec), buffer, size),
                None => put("", buffer, size),
            }
        }
    })
}

/// Number of golden steps: readings and targets by which a policy is checked where it runs; 0 for null.
///
/// # Safety
/// `controller` is null or of `ow_load`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_golden_steps(controller: *const OwController) -> usize {
    // SAFETY: as promised by the caller.
    unsafe { controller.as_ref() }.map_or(0, |it| it.policy.golden().steps.len())
}

/// Phase of the reset before the golden steps; 0 for null.
///
/// # Safety
/// `controller` is null or of `ow_load`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_golden_phase(controller: *const OwController) -> f32 {
    // SAFETY: as promised by the caller.
    unsafe { controller.as_ref() }.map_or(0.0, |it| it.policy.golden().clock_phase)
}

/// Sets readings (with `measured` at 0), desired velocity and expected targets of golden step `index`; the arrays are the
/// controller's and live as long as it does.
///
/// # Safety
/// `controller` is of `ow_load`; `readings` points to an `OwReadings`, `desired` to three places, `targets` to a place for a
/// pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn ow_golden_step(
    controller: *const OwController,
    index: usize,
    readings: *mut OwReadings,
    desired: *mut f32,
    targets: *mut *const f32,
) -> OwResult {
    guarded(|| {
        // SAFETY: as promised by the caller.
        let (it, readings) = unsafe { (given(controller, "controller")?, given_mut(readings, "readings")?) };
        // SAFETY: as promised by the caller; an array of three is as three places.
        let (desired, targets) = unsafe {
            (
                given_mut(desired.cast::<[f32; 3]>(), "desired")?,
                given_mut(targets, "targets")?,
            )
        };
        let steps = &it.policy.golden().steps;
        let step = steps
            .get(index)
            .ok_or_else(|| argument("there is no golden step of this index"))?;
        *readings = OwReadings {
            measured: 0,
            position: step.position.as_ptr(),
            velocity: step.velocity.as_ptr(),
            attitude: step.attitude,
            gyro: step.gyro,
            base_velocity: step.base_velocity.unwrap_or_default(),
            has_base_velocity: step.base_velocity.is_some(),
        };
        *desired = step.desired;
        *targets = step.targets.as_ptr();
        Ok(())
    })
}

#[cfg(test)]
mod tests;
