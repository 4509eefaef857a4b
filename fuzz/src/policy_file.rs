//! Policy files: what must hold for their loader, whatever the bytes are. An ordinary test of the controller uses it too.

use omniwalk_controller::{Controller, Policy, Sensors};

/// Offset of the table of sections, of the checksum behind it, and of the first section (docs/policy-file.md).
const TABLE: usize = 20;
const ENTRY: usize = 12;
const CHECKSUM: usize = 80;
const SECTIONS: usize = 84;

/// Loads `data` as it is, and once more with checksums made right: nobody hostile would leave them wrong.
pub fn check(data: &[u8]) {
    load(data);
    let mut sealed = data.to_vec();
    if seal(&mut sealed) {
        load(&sealed);
    }
}

/// What loads is written as the same bytes, and walks with targets that a robot can be sent.
fn load(data: &[u8]) {
    let Ok(policy) = Policy::from_bytes(data) else {
        return;
    };
    assert_eq!(policy.to_bytes(), data, "a file has one form");
    let mut controller = Controller::new(&policy).expect("what was loaded runs");
    let joints = policy.spec().joints.len();
    let mut targets = vec![f32::NAN; joints];
    let values = [0.0, -0.3, 1e30, f32::NAN, f32::INFINITY, f32::MIN_POSITIVE, 0.1, -2.0];
    for step in 0..24 {
        let value = |k: usize| {
            if step < 8 {
                0.01
            } else {
                values[(step + k) % values.len()]
            }
        };
        let row: Vec<f32> = (0..joints).map(value).collect();
        let sensors = Sensors {
            position: &row,
            velocity: &row,
            attitude: [value(1), value(2)],
            gyro: [value(3), value(4), value(5)],
            base_velocity: (step % 3 == 0).then_some([value(6), value(7), value(8)]),
        };
        let now = step as u64 * controller.period();
        let desired = [value(2), value(4), value(6)];
        let measured = if step % 7 == 6 { 0 } else { now };
        controller.step(now, measured, &sensors, desired, &mut targets);
        for (target, joint) in targets.iter().zip(&policy.spec().joints) {
            assert!(
                target.is_finite() && (joint.lower..=joint.upper).contains(target),
                "target {target} of joint {} leaves {} to {}",
                joint.name,
                joint.lower,
                joint.upper
            );
        }
    }
}

/// Makes length and checksums right where the table says which bytes they cover; false where it does not.
pub fn seal(bytes: &mut [u8]) -> bool {
    if bytes.len() < SECTIONS {
        return false;
    }
    let whole = bytes.len() as u32;
    bytes[16..20].copy_from_slice(&whole.to_le_bytes());
    let mut at = SECTIONS;
    for entry in (TABLE..CHECKSUM).step_by(ENTRY) {
        let len = u32::from_le_bytes([bytes[entry + 4], bytes[entry + 5], bytes[entry + 6], bytes[entry + 7]]) as usize;
        let rest = bytes.len() - at;
        // The last section takes what is left, so that files of another length are tried as well.
        let len = if entry + ENTRY == CHECKSUM { rest } else { len };
        if len > rest {
            return false;
        }
        bytes[entry + 4..entry + 8].copy_from_slice(&(len as u32).to_le_bytes());
        let sum = crc32(&bytes[at..at + len]);
        bytes[entry + 8..entry + 12].copy_from_slice(&sum.to_le_bytes());
        at += len;
    }
    let sum = crc32(&bytes[..CHECKSUM]);
    bytes[CHECKSUM..SECTIONS].copy_from_slice(&sum.to_le_bytes());
    true
}

/// The usual CRC-32, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = !0u32;
    for &byte in bytes {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
        }
    }
    !crc
}
