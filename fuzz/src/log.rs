//! MCAP logs: what is read is in order and finite, and can be judged.

use std::sync::LazyLock;

use omniwalk_env::robot::{Robot, load_with};
use omniwalk_sim2real::check::Check;
use omniwalk_sim2real::recording::{Recording, Samples, Series, read};

use super::scratch::with_file;

static ROBOT: LazyLock<Robot> = LazyLock::new(|| {
    let urdf = include_bytes!("../corpus/urdf/two_legs.urdf");
    with_file("urdf", urdf, |path| load_with(path, "")).expect("a robot of the corpus")
});

/// Reads `data` as an MCAP file.
pub fn check(data: &[u8]) {
    if let Ok(recordings) = with_file("mcap", data, |path| read(path, None)) {
        sound(&recordings);
    }
}

/// Times increase, values are numbers, and whether an answer can be had from them can be said.
pub fn sound(recordings: &[Recording]) {
    for recording in recordings {
        for joint in &recording.joints {
            let series = [
                &joint.command,
                &joint.position,
                &joint.velocity,
                &joint.effort,
                &joint.enabled,
            ];
            series.into_iter().chain(joint.extra.values()).for_each(finite);
        }
        finite(&recording.voltage);
        in_order(&recording.velocity_command);
        if let Some(imu) = &recording.imu {
            in_order(&imu.orientation);
            in_order(&imu.angular_velocity);
        }
        assert!(recording.overrides.values().all(|value| value.is_finite()));
    }
    let _ = Check::new(recordings, &ROBOT).usable();
}

fn finite(series: &Series) {
    in_order(series);
    assert!(series.value.iter().all(|value| value.is_finite()));
}

fn in_order<T>(samples: &Samples<T>) {
    assert_eq!(samples.time.len(), samples.value.len());
    assert!(samples.time.iter().all(|time| time.is_finite()));
    assert!(samples.time.windows(2).all(|pair| pair[0] < pair[1]));
}
