use alloc::{vec, vec::Vec};

use proptest::prelude::*;

use super::*;
use crate::{
    golden::GoldenError,
    policy::Bounds,
    spec::Spec,
    testing::{actor, biped, biped_mirror, identity, policy_with},
    weights::{Precision, Weights},
};

fn policy() -> Policy {
    let spec = Spec {
        symmetry: Some(biped_mirror()),
        ..biped()
    };
    policy_with(spec, |_, _| {})
}

/// Puts the right checksums on a file that was changed.
fn forge(bytes: &mut [u8]) {
    let mut at = HEADER_LEN;
    for i in 0..SECTIONS.len() {
        let entry = TABLE_AT + i * ENTRY_LEN;
        let len = u32::from_le_bytes(bytes[entry + 4..entry + 8].try_into().expect("four bytes")) as usize;
        let end = (at + len).min(bytes.len());
        let checksum = crc32(&bytes[at.min(end)..end]);
        bytes[entry + 8..entry + 12].copy_from_slice(&checksum.to_le_bytes());
        at = end;
    }
    let checksum = crc32(&bytes[..CHECKSUM_AT]);
    bytes[CHECKSUM_AT..HEADER_LEN].copy_from_slice(&checksum.to_le_bytes());
}

#[test]
fn the_checksum_is_the_usual_one() {
    assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
}

#[test]
fn a_policy_survives_writing_and_reading() {
    let policy = policy();
    let bytes = policy.to_bytes();
    let again = Policy::from_bytes(&bytes).expect("what was written is right");
    assert_eq!(again, policy);
    assert_eq!(again.to_bytes(), bytes);
}

#[test]
fn lower_precision_survives_as_well_and_costs_little() {
    let full = policy();
    let mut lengths = alloc::vec![full.to_bytes().len()];
    for (precision, most) in [(Precision::F16, 2e-3), (Precision::Int8, 5e-2)] {
        let small = full.with_precision(precision).expect("finite");
        let bytes = small.to_bytes();
        assert_eq!(Policy::from_bytes(&bytes), Ok(small.clone()));
        let error = small.golden_error(&full);
        assert!(error > 0.0 && error < most, "{precision:?}: {error}");
        lengths.push(bytes.len());
    }
    assert!(lengths.is_sorted_by(|a, b| a > b), "{lengths:?}");
    assert_eq!(full.golden_error(&full), 0.0);
}

#[test]
fn any_changed_byte_of_the_header_is_refused() {
    let bytes = policy().to_bytes();
    for at in 0..HEADER_LEN {
        for change in [0x01, 0x80, 0xFF] {
            let mut broken = bytes.clone();
            broken[at] ^= change;
            assert!(Policy::from_bytes(&broken).is_err(), "byte {at} ^ {change:#x}");
        }
    }
}

#[test]
fn any_changed_bit_of_the_rest_is_refused() {
    let bytes = policy().to_bytes();
    let bits = 8 * (bytes.len() - HEADER_LEN);
    let mut broken = bytes.clone();
    for i in 0..10_000 {
        let bit = 8 * HEADER_LEN + i * 2_654_435_761 % bits;
        broken[bit / 8] ^= 1 << (bit % 8);
        assert!(
            matches!(Policy::from_bytes(&broken), Err(FileError::Checksum { .. })),
            "bit {bit}"
        );
        broken[bit / 8] ^= 1 << (bit % 8);
    }
    assert_eq!(broken, bytes);
}

#[test]
fn any_truncation_or_addition_is_refused() {
    let bytes = policy().to_bytes();
    for len in (0..HEADER_LEN + 20)
        .chain((HEADER_LEN..bytes.len()).step_by(97))
        .chain([bytes.len() - 1])
    {
        assert!(Policy::from_bytes(&bytes[..len]).is_err(), "{len} bytes");
    }
    let mut longer = bytes;
    longer.push(0);
    assert!(matches!(Policy::from_bytes(&longer), Err(FileError::Length { .. })));
}

#[test]
fn another_version_says_so() {
    let mut bytes = policy().to_bytes();
    bytes[8] = 2;
    assert_eq!(Policy::from_bytes(&bytes), Err(FileError::Version { found: 2 }));
}

#[test]
fn a_network_that_was_exchanged_fails_its_golden_vectors() {
    let mut exchanged = policy();
    let Weights::F32(weights) = &mut exchanged.actor.layers[0].weights else {
        panic!("weights are stored as they are");
    };
    weights[5] += 0.5;
    let error = Policy::from_bytes(&exchanged.to_bytes()).expect_err("another network");
    assert!(
        matches!(
            error,
            FileError::Policy(PolicyError::Golden(GoldenError::Differs { what: "action", .. }))
        ),
        "{error}"
    );
}

#[test]
fn a_quantity_that_no_machine_has_is_refused_though_the_checksums_are_right() {
    let mut exchanged = policy();
    exchanged.spec.joints[3].kd = 1e30;
    let error = Policy::from_bytes(&exchanged.to_bytes()).expect_err("no machine's");
    let text = alloc::format!("{error}");
    assert!(
        text.contains("joint `left_knee`: kd is 1") && text.ends_with("but must be 0 to 1e9"),
        "{text}"
    );
}

#[test]
fn a_loop_that_was_exchanged_fails_its_golden_vectors() {
    let changes: [fn(&mut Policy); 6] = [
        |policy| {
            policy.spec.joints.swap(2, 3);
            policy.spec.joints.swap(7, 8);
        },
        |policy| policy.spec.action.filter = None,
        |policy| policy.spec.action.law = crate::ActionLaw::OffsetFromNominal,
        |policy| policy.spec.observation.swap(0, 1),
        |policy| policy.spec.clock.as_mut().expect("a clock").period = 0.7,
        |policy| policy.spec.legs[0].segments[3].translation[2] = -0.2,
    ];
    for (i, change) in changes.iter().enumerate() {
        let mut exchanged = policy();
        change(&mut exchanged);
        let error = Policy::from_bytes(&exchanged.to_bytes()).expect_err("another loop");
        assert!(
            matches!(
                error,
                FileError::Policy(PolicyError::Golden(GoldenError::Differs { .. }))
            ),
            "{i}: {error}"
        );
    }
}

#[test]
fn a_block_that_means_something_else_is_refused() {
    let mut bytes = policy().to_bytes();
    let unit = bytes.windows(5).position(|window| window == b"rad/s").expect("a unit");
    bytes[unit..unit + 5].copy_from_slice(b"deg/s");
    forge(&mut bytes);
    assert!(matches!(
        Policy::from_bytes(&bytes),
        Err(FileError::Malformed { section: "spec", .. })
    ));
}

#[test]
fn a_list_that_claims_to_be_endless_is_refused_before_it_is_allocated() {
    let mut bytes = policy().to_bytes();
    // The first list of the spec: its joints, after the control rate.
    bytes[HEADER_LEN + 4..HEADER_LEN + 8].copy_from_slice(&u32::MAX.to_le_bytes());
    forge(&mut bytes);
    assert!(matches!(
        Policy::from_bytes(&bytes),
        Err(FileError::Malformed { section: "spec", .. })
    ));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn a_forged_file_is_refused_or_works(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4)) {
        let original = policy();
        let mut bytes = original.to_bytes();
        // Half of the changes go to the spec, where the meaning is.
        let spec = codec::encode(&original.spec).len();
        for (i, (at, value)) in changes.iter().enumerate() {
            let end = if i % 2 == 0 { HEADER_LEN + spec } else { bytes.len() };
            let at = TABLE_AT + at.index(end - TABLE_AT);
            bytes[at] = *value;
        }
        forge(&mut bytes);
        if let Ok(policy) = Policy::from_bytes(&bytes) {
            prop_assert_eq!(policy.to_bytes(), bytes);
            prop_assert_eq!(policy.verify(), Ok(()));
        }
    }

    #[test]
    fn noise_is_refused(mut noise in prop::collection::vec(any::<u8>(), 0..400), with_head in any::<bool>()) {
        if with_head && noise.len() >= HEADER_LEN {
            noise[..12].copy_from_slice(&policy().to_bytes()[..12]);
            forge(&mut noise);
        }
        prop_assert!(Policy::from_bytes(&noise).is_err());
    }
}

#[test]
fn a_network_of_the_thesis_is_at_most_one_point_three_megabytes() {
    let spec = biped();
    let (width, joints) = (spec.observation_len(), spec.action_len());
    let bounds = Bounds {
        lower: vec![-1e9; width],
        upper: vec![1e9; width],
    };
    let policy = Policy::new(spec, actor(width, &[512, 512], joints), bounds, identity()).expect("fits");
    let bytes: Vec<u8> = policy.to_bytes();
    assert!(bytes.len() <= 1_300_000, "{}", bytes.len());
    assert!(Policy::from_bytes(&bytes).is_ok());
}
