//! Units that columns may be in.

/// What a unit measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Dimension {
    Time,
    Position,
    Velocity,
    Effort,
    Voltage,
}

const DEGREE: f64 = std::f64::consts::PI / 180.0;
const REVOLUTION: f64 = std::f64::consts::TAU;

/// Name, what it measures, and its value in SI units.
const UNITS: [(&str, Dimension, f64); 25] = [
    ("s", Dimension::Time, 1.0),
    ("ms", Dimension::Time, 1e-3),
    ("us", Dimension::Time, 1e-6),
    ("ns", Dimension::Time, 1e-9),
    ("rad", Dimension::Position, 1.0),
    ("deg", Dimension::Position, DEGREE),
    ("rev", Dimension::Position, REVOLUTION),
    ("m", Dimension::Position, 1.0),
    ("mm", Dimension::Position, 1e-3),
    ("rad/s", Dimension::Velocity, 1.0),
    ("deg/s", Dimension::Velocity, DEGREE),
    ("rev/s", Dimension::Velocity, REVOLUTION),
    ("rpm", Dimension::Velocity, REVOLUTION / 60.0),
    ("m/s", Dimension::Velocity, 1.0),
    ("mm/s", Dimension::Velocity, 1e-3),
    ("N m", Dimension::Effort, 1.0),
    ("Nm", Dimension::Effort, 1.0),
    ("mN m", Dimension::Effort, 1e-3),
    ("mNm", Dimension::Effort, 1e-3),
    ("kgf cm", Dimension::Effort, 0.098_066_5),
    ("kg cm", Dimension::Effort, 0.098_066_5),
    ("N", Dimension::Effort, 1.0),
    ("mN", Dimension::Effort, 1e-3),
    ("V", Dimension::Voltage, 1.0),
    ("mV", Dimension::Voltage, 1e-3),
];

/// What the unit `name` measures, and its value in SI units.
pub(super) fn unit(name: &str) -> Option<(Dimension, f64)> {
    let unit = UNITS.iter().find(|(known, ..)| *known == name);
    unit.map(|(_, dimension, factor)| (*dimension, *factor))
}

/// Names of the units that measure one of `right`.
pub(super) fn fitting(right: &[Dimension]) -> String {
    let fitting = UNITS.iter().filter(|(_, dimension, _)| right.contains(dimension));
    let names: Vec<&str> = fitting.map(|(name, ..)| *name).collect();
    names.join(", ")
}
