//! What the page may ask of the robot. Whatever comes over the socket is judged here.

use serde::{Deserialize, Serialize};

/// Longest message, bytes.
pub const LONGEST: usize = 1024;
/// Strongest push, as a share of the robot's weight, and how long it lasts, s.
pub const MOST_PUSH: f64 = 1.0;
/// Duration of a push, s.
pub const PUSH_SECONDS: f64 = 0.2;

/// An order.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Order {
    /// Walk at this velocity (m/s, m/s, rad/s); it has to be repeated, or the robot stops.
    Walk {
        /// The velocity.
        velocity: [f32; 3],
    },
    /// Push the base horizontally (world frame, N) for [`PUSH_SECONDS`].
    Push {
        /// The force.
        force: [f64; 2],
    },
    /// Change a condition under the walking robot.
    Set {
        /// Which.
        condition: Condition,
        /// To what, in the condition's unit.
        value: f64,
    },
    /// Stand up where the robot is.
    Stand {},
    /// Begin or end a recording.
    Record {
        /// Whether to record.
        on: bool,
    },
}

/// What can change while the robot walks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Condition {
    /// Tangential friction coefficient of the soles.
    Friction,
    /// Age of a reading when the controller gets it, s.
    Latency,
    /// Mass carried at the base link's centre of mass, kg.
    Payload,
}

/// Range of a condition, and what it was to begin with.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Range {
    /// Smallest value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
    /// Value at the start.
    pub start: f64,
}

/// What orders may ask for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Limits {
    /// Velocities that were trained, m/s, m/s, rad/s.
    pub velocity: [[f32; 3]; 2],
    /// Friction coefficient.
    pub friction: Range,
    /// Latency, s.
    pub latency: Range,
    /// Payload, kg.
    pub payload: Range,
    /// Strongest push, N.
    pub push: f64,
}

impl Limits {
    /// The range of `condition`.
    pub fn of(&self, condition: Condition) -> Range {
        match condition {
            Condition::Friction => self.friction,
            Condition::Latency => self.latency,
            Condition::Payload => self.payload,
        }
    }

    /// The order in `text`.
    ///
    /// # Errors
    /// What is wrong with it, in words for the sender.
    pub fn parse(&self, text: &str) -> Result<Order, String> {
        if text.len() > LONGEST {
            return Err(format!("an order has at most {LONGEST} bytes, this one {}", text.len()));
        }
        let order: Order = serde_json::from_str(text).map_err(|error| format!("not an order: {error}"))?;
        match order {
            Order::Walk { velocity } if velocity.iter().any(|x| !x.is_finite()) => {
                Err("a velocity is three finite numbers".to_owned())
            }
            Order::Push { force: [x, y] } if x.hypot(y) > self.push => {
                Err(format!("a push has at most {:.0} N", self.push))
            }
            Order::Set { condition, value } => {
                let Range { lower, upper, .. } = self.of(condition);
                match (lower..=upper).contains(&value) {
                    true => Ok(order),
                    false => Err(format!("{condition:?} is from {lower} to {upper}, not {value}").to_lowercase()),
                }
            }
            _ => Ok(order),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn limits() -> Limits {
        let range = |upper| Range {
            lower: 0.0,
            upper,
            start: 0.0,
        };
        Limits {
            velocity: [[-1.0; 3], [1.0; 3]],
            friction: range(1.5),
            latency: range(0.1),
            payload: range(9.0),
            push: 180.0,
        }
    }

    #[test]
    fn orders_are_taken_and_everything_else_is_answered_with_what_is_wrong() {
        let walk = limits().parse(r#"{"type": "walk", "velocity": [0.3, -0.1, 0]}"#);
        assert_eq!(
            walk,
            Ok(Order::Walk {
                velocity: [0.3, -0.1, 0.0]
            })
        );
        let set = limits().parse(r#"{"type": "set", "condition": "latency", "value": 0.1}"#);
        let (condition, value) = (Condition::Latency, 0.1);
        assert_eq!(set, Ok(Order::Set { condition, value }));
        assert_eq!(limits().parse(r#"{"type": "stand"}"#), Ok(Order::Stand {}));
        let long = format!("{:2000}", "");
        for (text, part) in [
            ("", "not an order"),
            ("[[[[", "not an order"),
            (r#"{"type": "fly"}"#, "unknown variant"),
            (r#"{"type": "stand", "up": 1}"#, "unknown field"),
            (r#"{"type": "walk", "velocity": [1, 2]}"#, "not an order"),
            (r#"{"type": "walk", "velocity": [1e99, 0, 0]}"#, "finite"),
            (r#"{"type": "walk", "velocity": [1e999, 0, 0]}"#, "not an order"),
            (r#"{"type": "push", "force": [150, 150]}"#, "at most 180 N"),
            (
                r#"{"type": "set", "condition": "friction", "value": -0.1}"#,
                "friction is from 0 to 1.5, not -0.1",
            ),
            (
                r#"{"type": "set", "condition": "gravity", "value": 1}"#,
                "unknown variant",
            ),
            (&long, "at most 1024 bytes"),
        ] {
            let error = limits().parse(text).expect_err(text);
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    proptest! {
        #[test]
        fn no_text_is_more_than_a_wrong_order(text in ".{0,200}") {
            let _ = limits().parse(&text);
        }

        #[test]
        fn pushes_that_are_taken_are_within_the_limit(x in -1e3..1e3f64, y in -1e3..1e3f64) {
            let text = format!(r#"{{"type": "push", "force": [{x}, {y}]}}"#);
            prop_assert_eq!(limits().parse(&text).is_ok(), x.hypot(y) <= 180.0);
        }
    }
}
