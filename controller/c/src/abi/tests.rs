use super::*;
use crate::types::{OwFault, OwMode, OwReading};

#[test]
fn null_pointers_and_noise_are_refused() {
    let mut controller = std::ptr::null_mut();
    let noise = [7u8; 100];
    // SAFETY: what is not null is valid.
    unsafe {
        assert_eq!(ow_load(std::ptr::null(), 5, &mut controller), OwResult::Argument);
        assert_eq!(ow_load(noise.as_ptr(), 100, std::ptr::null_mut()), OwResult::Argument);
        assert_eq!(ow_load(noise.as_ptr(), 100, &mut controller), OwResult::Policy);
        assert_eq!(ow_load_file(c"/nowhere".as_ptr(), &mut controller), OwResult::Io);
        assert_eq!(ow_load_file(c"/".as_ptr(), &mut controller), OwResult::Io);
        let message = std::ffi::CStr::from_ptr(ow_message()).to_str().expect("text");
        assert_eq!(message, "cannot read /: it is not a file");
        controller = std::ptr::dangling_mut();
        assert_eq!(ow_load(noise.as_ptr(), 100, &mut controller), OwResult::Policy);
        assert!(controller.is_null());
        assert!(controller.is_null());
        assert_eq!(ow_reset(controller, 0.0), OwResult::Argument);
        assert_eq!((ow_joints(controller), ow_golden_steps(controller)), (0, 0));
        ow_free(controller);
    }
}

#[test]
fn what_no_pointer_or_length_can_be_is_refused_by_name() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../runs/nimbro_op2x_omni/policy.omni");
    let policy = std::fs::read(path).expect("the walk of the repository");
    let mut controller = std::ptr::null_mut();
    let mut numbers = [0.0f32; 256];
    let readings = OwReadings {
        measured: 0,
        position: numbers.as_ptr().wrapping_byte_add(1),
        velocity: numbers.as_ptr(),
        attitude: [0.0; 2],
        gyro: [0.0; 3],
        base_velocity: [0.0; 3],
        has_base_velocity: false,
    };
    let refused = |result, expected: &str| {
        // SAFETY: nothing else was called since.
        let message = unsafe { std::ffi::CStr::from_ptr(ow_message()) };
        assert_eq!((result, message.to_str()), (OwResult::Argument, Ok(expected)));
    };
    // SAFETY: what cannot be is not followed, all else is valid.
    unsafe {
        let result = ow_load(policy.as_ptr(), usize::MAX, &mut controller);
        refused(result, "bytes cannot have a length of 18446744073709551615");
        assert_eq!(ow_load(policy.as_ptr(), policy.len(), &mut controller), OwResult::Ok);
        let joints = ow_joints(controller);
        let most = isize::MAX as usize;
        let result = ow_take_over(controller, numbers.as_ptr(), most);
        refused(result, "position cannot have a length of 9223372036854775807");
        let result = ow_check_joints(controller, std::ptr::dangling(), most);
        refused(result, "names cannot have a length of 9223372036854775807");
        let desired = [0.0; 3].as_ptr();
        let result = ow_step(
            controller,
            0,
            &readings,
            desired,
            numbers.as_mut_ptr(),
            joints,
            std::ptr::null_mut(),
        );
        refused(result, "position is not aligned");
        let readings = OwReadings {
            position: readings.velocity,
            ..readings
        };
        let result = ow_step(
            controller,
            0,
            &readings,
            desired,
            std::ptr::null_mut(),
            joints,
            std::ptr::null_mut(),
        );
        refused(result, "targets is null");
        let result = ow_step(
            controller,
            0,
            &readings,
            desired,
            numbers.as_mut_ptr(),
            joints + 1,
            std::ptr::null_mut(),
        );
        refused(result, "17 targets instead of 16");
        ow_free(controller);
    }
}

#[test]
fn positions_that_cannot_be_are_refused_and_a_status_is_told_in_words() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../runs/nimbro_op2x_omni/policy.omni");
    let policy = std::fs::read(path).expect("the walk of the repository");
    let mut controller = std::ptr::null_mut();
    let mut buffer = [1 as c_char; 200];
    // SAFETY: all pointers are those of what is here.
    unsafe {
        assert_eq!(ow_load(policy.as_ptr(), policy.len(), &mut controller), OwResult::Ok);
        let mut text = |controller| {
            assert_eq!(
                ow_status_message(controller, buffer.as_mut_ptr(), buffer.len()),
                OwResult::Ok
            );
            std::ffi::CStr::from_ptr(buffer.as_ptr())
                .to_str()
                .expect("text")
                .to_owned()
        };
        assert_eq!(text(controller), "", "nothing was done yet");
        let joints = ow_joints(controller);
        let mut position = vec![0.0; joints];
        position[3] = f32::NAN;
        let name = &(*controller).policy.spec().joints[3].name;
        let expected = format!("position[{name}] is not a finite number");
        assert_eq!(ow_take_over(controller, position.as_ptr(), joints), OwResult::Readings);
        let message = std::ffi::CStr::from_ptr(ow_message()).to_str().expect("text");
        assert_eq!(message, expected);
        let readings = OwReadings {
            measured: 0,
            position: position.as_ptr(),
            velocity: [0.0; 256].as_ptr(),
            attitude: [0.0; 2],
            gyro: [0.0; 3],
            base_velocity: [0.0; 3],
            has_base_velocity: false,
        };
        let (mut targets, mut status) = (vec![0.0; joints], std::mem::MaybeUninit::<OwStatus>::uninit());
        let desired = [0.0; 3];
        let stepped = ow_step(
            controller,
            0,
            &readings,
            desired.as_ptr(),
            targets.as_mut_ptr(),
            joints,
            status.as_mut_ptr(),
        );
        assert_eq!(stepped, OwResult::Ok);
        let status = status.assume_init();
        assert_eq!((status.mode, status.fault), (OwMode::Holding, OwFault::NotFinite));
        assert_eq!((status.reading, status.reading_index), (OwReading::Position, 3));
        assert_eq!(text(controller), expected);
        assert_eq!(ow_status_message(controller, buffer.as_mut_ptr(), 9), OwResult::Ok);
        assert_eq!(
            std::ffi::CStr::from_ptr(buffer.as_ptr()),
            c"position",
            "cut off where it does not fit"
        );
        ow_free(controller);
    }
}
