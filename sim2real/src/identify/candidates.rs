//! Which effects are tried on which joints and links, and where their fits start.

use nalgebra::Vector3;
use omniwalk_env::effect::{Kind, Scale, Site};
use omniwalk_env::robot::{Actuator, Robot};

use super::descent::{Descent, newton, sum};
use super::fit::{Data, Fit, total};
use super::model::{Model, Term, Tuned, joint_of};
use super::scales::Scales;

/// An effect that may be missing, or more numbers of one that is there, with every start of its fit.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The effect.
    pub kind: Kind,
    /// Degree of freedom or link.
    pub target: usize,
    /// Which of the ways the effect can be; ways to refine it follow.
    pub variant: usize,
    /// One model of it a start.
    pub starts: Vec<Term>,
}

impl Candidate {
    /// What tells candidates apart.
    pub fn key(&self) -> (Kind, usize, usize) {
        (self.kind, self.target, self.variant)
    }

    /// The degree of freedom whose numbers are fitted beside it: the one it is at. What a link weighs moves all of a limb, and all of its numbers
    /// bend to that (`None`); those of a robot on the ground are too many.
    pub fn joint(&self, robot: &Robot, data: &Data) -> Option<usize> {
        let site = self.kind.info().site;
        let moves_all = site == Site::Link && !data.is_free();
        (!moves_all).then(|| joint_of(robot, site, self.target)).flatten()
    }

    /// The way to the fit of `model` with it, from the values of `model`, begun.
    fn way(&self, robot: &Robot, data: &Data, model: &Model, scales: &Scales) -> Descent {
        let with = |term: &Term| {
            let mut model = model.clone();
            model.put(term.clone());
            model.hold_others(robot, self.joint(robot, data));
            model
        };
        let starts = self.starts.iter().map(with).collect();
        Descent::begun(data, &promising(data, starts, scales), scales)
    }
}

/// Frequencies (cycles per rad or m) that a ripple's fit starts from, by degree of freedom.
pub type Ripples = Vec<Vec<f64>>;

/// Numbers of an effect that are fitted together, once the effect is there: how it departs from its simplest form.
pub fn refinements(kind: Kind) -> &'static [&'static [usize]] {
    match kind {
        Kind::LoadDependentFriction => &[&[1], &[2, 3]],
        Kind::DirectionalFriction => &[&[1]],
        Kind::Payload => &[&[1, 2, 3]],
        Kind::StribeckFriction | Kind::Backlash | Kind::Elasticity => &[&[2]],
        _ => &[],
    }
}

/// First variant of the refinements.
const REFINED: usize = 10;

/// What the effects of `model` may be refined by.
pub fn finer(model: &Model, scales: &Scales) -> Vec<Candidate> {
    model.terms.iter().flat_map(|term| refined(term, scales)).collect()
}

/// Everything of the catalogue that `model` does not have yet and that `robot` can have.
pub fn all(robot: &Robot, data: &Data, model: &Model, scales: &Scales, ripples: &Ripples) -> Vec<Candidate> {
    let mut out = Vec::new();
    for &kind in Kind::ALL {
        let info = kind.info();
        let targets = match info.site {
            Site::Joint => 0..robot.dofs.len(),
            Site::Link => 1..robot.links.len(),
        };
        for target in targets {
            if model.has(kind, target) || !applies(kind, target, robot, data, model) {
                continue;
            }
            out.extend(each(kind, target, robot, scales, ripples));
        }
    }
    out
}

/// Each of the ways the effect `kind` on `target` can be.
pub fn each(kind: Kind, target: usize, robot: &Robot, scales: &Scales, ripples: &[Vec<f64>]) -> Vec<Candidate> {
    let variants = variants(kind, target, robot, scales, ripples).into_iter().enumerate();
    let one = |(variant, starts): (usize, Vec<Term>)| Candidate {
        kind,
        target,
        variant,
        starts,
    };
    variants
        .map(one)
        .filter(|candidate| !candidate.starts.is_empty())
        .collect()
}

/// What `term` may be refined by.
fn refined<'a>(term: &'a Term, scales: &'a Scales) -> impl Iterator<Item = Candidate> + 'a {
    let info = term.kind.info();
    let start = |group: &[usize], pick: usize| {
        let mut term = term.clone();
        for &i in group {
            let parameter = &info.parameters[i];
            let unit = scales.of(parameter.scale, info.site, term.target);
            // What has no start of its own begins where the simplest form has it.
            if let Some(start) = parameter.starts.get(pick).or(parameter.starts.last()) {
                term.values[i] = unit * start;
            }
            term.free.push(i);
        }
        term.free.sort_unstable();
        term
    };
    let groups = refinements(term.kind).iter().enumerate();
    let new = groups.filter(|(_, group)| !term.free.contains(&group[0]));
    new.map(move |(k, group)| {
        let count = group.iter().map(|&i| info.parameters[i].starts.len()).max();
        Candidate {
            kind: term.kind,
            target: term.target,
            variant: REFINED + k,
            starts: (0..count.unwrap_or(0).max(1)).map(|pick| start(group, pick)).collect(),
        }
    })
}

fn applies(kind: Kind, target: usize, robot: &Robot, data: &Data, model: &Model) -> bool {
    let is_its = |own: &Tuned| own.dof == target && own.own.kind() == Some(kind);
    if kind.info().site == Site::Joint && model.tuned.iter().any(is_its) {
        return false;
    }
    let efforts = || data.trials.iter().any(|trial| trial.told[target].effort);
    let actuator = || robot.dof(target).actuator;
    match kind {
        Kind::ResidualTorque => false,
        // The nominal parameters it scales are tuned already.
        Kind::SupplyVoltage => false,
        Kind::TorqueLimit | Kind::SpeedTorqueCurve | Kind::CommandDelay => actuator().is_some(),
        Kind::CommandRateLimit | Kind::CommandDeadBand | Kind::CommandGain | Kind::CommandQuantisation => {
            actuator().is_some() && !efforts()
        }
        Kind::Backlash | Kind::Elasticity | Kind::LoadDependentFriction => {
            actuator().is_some_and(|a: Actuator| a.torque_limit > 0.0)
        }
        Kind::Mass | Kind::CentreOfMass | Kind::Payload => robot.links[target].inertial.mass > 0.0,
        _ => true,
    }
}

/// The starts of each way the effect can be: some have several, of which one is true.
fn variants(kind: Kind, target: usize, robot: &Robot, scales: &Scales, ripples: &[Vec<f64>]) -> Vec<Vec<Term>> {
    let info = kind.info();
    let scale = |i: usize| scales.of(info.parameters[i].scale, info.site, target);
    let start = |i: usize| -> Vec<f64> {
        let parameter = &info.parameters[i];
        let absolute = parameter.scale == Scale::Time;
        let unit = if absolute { 1.0 } else { scale(i) };
        parameter.starts.iter().map(|s| s * unit).collect()
    };
    // A single number is looked for over decades: gaps and limits have errors that are flat far from the truth.
    let ladder = |i: usize| -> Vec<f64> {
        let neutral = info.parameters[i].neutral.unwrap_or(0.0);
        let unit = if info.parameters[i].scale == Scale::One {
            neutral
        } else {
            0.0
        };
        let spread = |s: f64| LADDER.map(|factor| unit + factor * (s - unit));
        start(i).into_iter().flat_map(spread).collect()
    };
    // What is not told is as the catalogue has it.
    let plain = |value: f64| -> Vec<f64> {
        let own = info.parameters.iter().skip(1).map(|p| p.default.unwrap_or(0.0));
        [value].into_iter().chain(own).collect()
    };
    let term = |values: Vec<f64>, free: Vec<usize>| Term {
        kind,
        target,
        values,
        free,
        table: None,
        held: false,
    };
    match kind {
        // A rotor that bounces makes another motion of the joint than one that does not, and no slope leads from one to the other.
        Kind::Backlash | Kind::Elasticity => {
            let each = |x: f64, encoder: f64| start(2).into_iter().map(move |ratio| vec![x, encoder, ratio]);
            let at = |encoder: f64| ladder(0).into_iter().flat_map(move |x| each(x, encoder));
            let terms = |encoder: f64| at(encoder).map(|values| term(values, vec![0])).collect();
            vec![terms(0.0), terms(1.0)]
        }
        Kind::StribeckFriction => {
            let each = |torque: f64| start(1).into_iter().map(move |v| vec![torque, v, 0.0]);
            vec![
                start(0)
                    .into_iter()
                    .flat_map(each)
                    .map(|v| term(v, vec![0, 1]))
                    .collect(),
            ]
        }
        // What gears rub under load is often so much more at rest that no slope leads there from what does not know of it.
        Kind::LoadDependentFriction => {
            let at_rest = |c: f64| start(3).into_iter().map(move |v| vec![c, 0.0, c, v]);
            vec![
                ladder(0).into_iter().map(|x| term(plain(x), vec![0])).collect(),
                start(0)
                    .into_iter()
                    .flat_map(at_rest)
                    .map(|v| term(v, vec![0, 2, 3]))
                    .collect(),
            ]
        }
        Kind::PositionRipple => {
            let amplitude = 0.0;
            let highest = kind.info().parameters[2].bounds.upper;
            let own = ripples[target]
                .iter()
                .filter(|&&f| f <= highest)
                .map(|&f| term(vec![amplitude, amplitude, f], vec![0, 1, 2]));
            vec![own.collect()]
        }
        Kind::CentreOfMass => vec![vec![term(vec![0.0; 3], vec![0, 1, 2])]],
        Kind::Payload => {
            // Spread over the link, or at its end: twice as far from its joint, were it of one thickness.
            let com = robot.links[target].inertial.com;
            let at = |place: Vector3<f64>| {
                let load = |mass: f64| term(vec![mass, place.x, place.y, place.z], vec![0]);
                start(0).into_iter().map(load).collect()
            };
            vec![at(com), at(2.0 * com)]
        }
        _ => vec![ladder(0).into_iter().map(|x| term(plain(x), vec![0])).collect()],
    }
}

/// Multiples of a single number's starts (of their distance from what does nothing) that are tried.
const LADDER: [f64; 4] = [0.25, 0.5, 1.0, 2.0];
/// A way with so many times the least loss of all candidates' is hopeless, if it is slow.
const HOPELESS: f64 = 3.0;
/// Share of the loss that the last iteration of a slow way took.
const SLOW: f64 = 0.05;
/// Starts that are followed for a step before the best is fitted.
const FOLLOWED: usize = 3;

/// The way to a candidate's fit.
pub struct Attempt {
    /// From the re-tuned values, and from the nominal ones: those bent to make up for what is missing, and from there the way is often
    /// uphill. Or from those beside another effect.
    ways: Vec<Descent>,
}

impl Attempt {
    /// Begins to fit `model` with the candidate beside it. What is on other joints is held: it is fitted again when the candidate is
    /// taken.
    pub fn begin(robot: &Robot, data: &Data, model: &Model, candidate: &Candidate, scales: &Scales) -> Self {
        let mut straight = model.clone();
        straight.hold_others(robot, candidate.joint(robot, data));
        straight.straighten();
        let ways = [model, &straight].map(|from| candidate.way(robot, data, from, scales));
        Self { ways: ways.into() }
    }

    /// No effect beside `model`: its numbers of degree of freedom `joint`, or all of them, fitted from the same two starts.
    pub fn plain(robot: &Robot, data: &Data, model: &Model, joint: Option<usize>, scales: &Scales) -> Self {
        let mut model = model.clone();
        model.hold_others(robot, joint);
        let mut straight = model.clone();
        straight.straighten();
        let ways = [model, straight].map(|from| Descent::begun(data, &from, scales));
        Self { ways: ways.into() }
    }

    /// A candidate from `model` as it is alone, which was re-tuned beside an effect in whose place the candidate is tried.
    pub fn in_place(robot: &Robot, data: &Data, model: &Model, candidate: &Candidate, scales: &Scales) -> Self {
        Self {
            ways: vec![candidate.way(robot, data, model, scales)],
        }
    }

    /// The least loss so far.
    pub fn loss(&self) -> f64 {
        self.ways.iter().map(Descent::loss).fold(f64::INFINITY, f64::min)
    }

    /// Goes on to the end, but with ways that are [`HOPELESS`] times above `best` and fall slowly.
    pub fn go_on(&mut self, data: &Data, scales: &Scales, best: f64) {
        let hopeful = |way: &&mut Descent| way.fell > SLOW || way.loss() <= HOPELESS * best;
        for way in self.ways.iter_mut().filter(hopeful) {
            way.go_on(data, scales);
        }
    }

    /// The better fit.
    pub fn fit(self) -> Fit {
        let mut ways = self.ways.into_iter();
        let first = ways.next().expect("an attempt has a way");
        ways.fold(first, |best, way| if way.loss() < best.loss() { way } else { best })
            .fit
    }
}

/// The one of `starts` that is best, or leads to the best, after a step.
pub fn promising(data: &Data, mut starts: Vec<Model>, scales: &Scales) -> Model {
    if starts.len() > 1 {
        let at_start = data.losses(&starts);
        let mut order: Vec<usize> = (0..starts.len()).collect();
        order.sort_by(|&a, &b| total(&at_start[a]).total_cmp(&total(&at_start[b])));
        order.truncate(FOLLOWED);
        starts = order.into_iter().map(|i| starts[i].clone()).collect();
        let step = |start: &Model| {
            let (_, slopes) = data.slopes(start, scales);
            let (x, free) = (start.get(scales), start.free(scales));
            let (gradient, curvature) = sum(&slopes, &|_| true, x.len());
            start.at(&newton(&x, &free, &gradient, &curvature, 1e-2), scales)
        };
        let stepped: Vec<Model> = starts.iter().map(step).collect();
        starts.extend(stepped);
        let losses = data.losses(&starts);
        let best = (0..starts.len()).min_by(|&a, &b| total(&losses[a]).total_cmp(&total(&losses[b])));
        starts.swap(0, best.unwrap_or(0));
    }
    starts.swap_remove(0)
}
