//! Mass properties of links. They change the robot itself, so every engine has them.

use nalgebra::{Matrix3, Vector3};

use super::catalogue::{Bounds, Info, Parameter, Place, Scale, Site, positive, signed};
use crate::robot::Inertial;

pub(super) const MASS: Info = Info {
    id: "mass",
    site: Site::Link,
    place: Place::Table,
    parameters: &[Parameter {
        name: "factor",
        scale: Scale::One,
        neutral: Some(1.0),
        starts: &[0.9, 1.1],
        bounds: Bounds {
            lower: 0.01,
            upper: 100.0,
        },
        default: None,
        what: "true over nominal mass",
    }],
    what: "mass and inertia of a link are multiplied by a factor",
};

pub(super) const CENTRE_OF_MASS: Info = Info {
    id: "centre_of_mass",
    site: Site::Link,
    place: Place::Table,
    parameters: &[shift("x"), shift("y"), shift("z")],
    what: "the centre of mass of a link is shifted, link frame",
};

const fn shift(name: &'static str) -> Parameter {
    Parameter {
        name,
        scale: Scale::Length,
        neutral: Some(0.0),
        starts: &[0.0],
        bounds: signed(10.0),
        default: Some(0.0),
        what: "shift along this axis",
    }
}

pub(super) const PAYLOAD: Info = Info {
    id: "payload",
    site: Site::Link,
    place: Place::Table,
    parameters: &[
        Parameter {
            name: "mass",
            scale: Scale::Mass,
            neutral: Some(0.0),
            starts: &[0.1],
            bounds: positive(1e4),
            default: None,
            what: "mass of the load",
        },
        place("x"),
        place("y"),
        place("z"),
    ],
    what: "a point mass on a link, at a place in the link frame",
};

const fn place(name: &'static str) -> Parameter {
    Parameter {
        name,
        scale: Scale::Length,
        neutral: None,
        starts: &[],
        bounds: signed(10.0),
        default: Some(0.0),
        what: "place of the load along this axis",
    }
}

/// `inertial` with `factor` times the mass.
pub(super) fn scaled(inertial: &mut Inertial, factor: f64) {
    inertial.mass *= factor;
    inertial.inertia *= factor;
}

/// `inertial` with its centre of mass moved.
pub(super) fn shifted(inertial: &mut Inertial, by: Vector3<f64>) {
    inertial.com += by;
}

/// `inertial` with a point mass at `place`.
pub(super) fn loaded(inertial: &mut Inertial, mass: f64, place: Vector3<f64>) {
    let load = Inertial {
        mass,
        com: place,
        inertia: Matrix3::zeros(),
    };
    *inertial = inertial.combined(&load);
}
