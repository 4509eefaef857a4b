//! The ROS 2 messages of a log. A struct is its message's one definition: the `ros2msg` schema, CDR and JSON follow from it.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::cdr::{Decoder, Encoder, Field, define_message};

macro_rules! messages {
    ($(
        $(#[$doc:meta])*
        $ros:literal $name:ident { $( $(#[$field_doc:meta])* $field:ident: $type:ty, )* }
    )*) => {$(
        $(#[$doc])*
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(default)]
        pub struct $name { $( $(#[$field_doc])* pub $field: $type, )* }

        impl Field for $name {
            fn type_name() -> String {
                $ros.to_owned()
            }
            fn define(definitions: &mut Vec<(String, String)>) {
                $( <$type>::define(definitions); )*
                define_message($ros, &[$( (stringify!($field), <$type>::type_name()) ),*], definitions);
            }
            fn encode(&self, encoder: &mut Encoder) {
                $( self.$field.encode(encoder); )*
            }
            fn decode(decoder: &mut Decoder<'_>) -> Result<Self, String> {
                Ok(Self { $( $field: Field::decode(decoder)?, )* })
            }
        }
    )*};
}

messages! {
    /// A time, or a duration since the start of a simulation.
    "builtin_interfaces/Time" Time {
        /// Whole seconds.
        sec: i32,
        /// The rest, ns.
        nanosec: u32,
    }
    /// When and in which frame a message was measured.
    "std_msgs/Header" Header {
        /// When.
        stamp: Time,
        /// Name of the frame.
        frame_id: String,
    }
    /// A vector; unit and frame are those of the message it is in.
    "geometry_msgs/Vector3" Vector3 {
        /// Component along x.
        x: f64,
        /// Component along y.
        y: f64,
        /// Component along z.
        z: f64,
    }
    /// A position, m.
    "geometry_msgs/Point" Point {
        /// Along x.
        x: f64,
        /// Along y.
        y: f64,
        /// Along z.
        z: f64,
    }
    /// A rotation.
    "geometry_msgs/Quaternion" Quaternion {
        /// First imaginary part.
        x: f64,
        /// Second imaginary part.
        y: f64,
        /// Third imaginary part.
        z: f64,
        /// Real part.
        w: f64,
    }
    /// Position and orientation.
    "geometry_msgs/Pose" Pose {
        /// Position, m.
        position: Point,
        /// Orientation.
        orientation: Quaternion,
    }
    /// Linear (m/s) and angular (rad/s) velocity.
    "geometry_msgs/Twist" Twist {
        /// Linear velocity, m/s.
        linear: Vector3,
        /// Angular velocity, rad/s.
        angular: Vector3,
    }
    /// A pose and how sure it is.
    "geometry_msgs/PoseWithCovariance" PoseWithCovariance {
        /// The pose.
        pose: Pose,
        /// Row-major 6 x 6; zero where not known.
        covariance: Covariance<36>,
    }
    /// A twist and how sure it is.
    "geometry_msgs/TwistWithCovariance" TwistWithCovariance {
        /// The twist.
        twist: Twist,
        /// Row-major 6 x 6; zero where not known.
        covariance: Covariance<36>,
    }
    /// Positions, velocities and efforts of joints: measured on `/joint_states`, targets on `/joint_commands`.
    "sensor_msgs/JointState" JointState {
        /// When.
        header: Header,
        /// Names of the joints, in any order.
        name: Vec<String>,
        /// Positions, rad or m; as many as names, or none.
        position: Vec<f64>,
        /// Velocities, rad/s or m/s; as many as names, or none.
        velocity: Vec<f64>,
        /// Efforts, N m or N; as many as names, or none.
        effort: Vec<f64>,
    }
    /// Readings of an inertial measurement unit.
    "sensor_msgs/Imu" Imu {
        /// When, and the IMU's frame.
        header: Header,
        /// Orientation of the base in the world.
        orientation: Quaternion,
        /// Row-major 3 x 3; zero where not known, -1 first where there is no orientation.
        orientation_covariance: Covariance<9>,
        /// Angular velocity, rad/s.
        angular_velocity: Vector3,
        /// Row-major 3 x 3; zero where not known.
        angular_velocity_covariance: Covariance<9>,
        /// Specific force, m/s^2.
        linear_acceleration: Vector3,
        /// Row-major 3 x 3; zero where not known.
        linear_acceleration_covariance: Covariance<9>,
    }
    /// Pose and velocity of the base.
    "nav_msgs/Odometry" Odometry {
        /// When, and the frame of the pose.
        header: Header,
        /// The frame of the twist.
        child_frame_id: String,
        /// Pose of the base.
        pose: PoseWithCovariance,
        /// Velocity of the base in its own frame.
        twist: TwistWithCovariance,
    }
    /// The supply of a robot.
    "sensor_msgs/BatteryState" BatteryState {
        /// When.
        header: Header,
        /// Voltage, V.
        voltage: f32,
        /// Temperature, deg C; NaN where not measured.
        temperature: f32,
        /// Current, A, negative when discharging; NaN where not measured.
        current: f32,
        /// Charge, A h; NaN where not measured.
        charge: f32,
        /// Last full charge, A h; NaN where not measured.
        capacity: f32,
        /// Charge when new, A h; NaN where not measured.
        design_capacity: f32,
        /// Charge from 0 to 1; NaN where not measured.
        percentage: f32,
        /// Charging or not, by the message's constants.
        power_supply_status: u8,
        /// Health, by the message's constants.
        power_supply_health: u8,
        /// Chemistry, by the message's constants.
        power_supply_technology: u8,
        /// Whether there is a battery.
        present: bool,
        /// Voltage of each cell, V.
        cell_voltage: Vec<f32>,
        /// Temperature of each cell, deg C.
        cell_temperature: Vec<f32>,
        /// Where the battery is.
        location: String,
        /// Its serial number.
        serial_number: String,
    }
    /// A motion from one frame to another.
    "geometry_msgs/Transform" Transform {
        /// Translation, m.
        translation: Vector3,
        /// Rotation.
        rotation: Quaternion,
    }
    /// Pose of the frame `child_frame_id` in the header's frame.
    "geometry_msgs/TransformStamped" TransformStamped {
        /// When, and the parent frame.
        header: Header,
        /// The child frame.
        child_frame_id: String,
        /// The child's pose.
        transform: Transform,
    }
    /// Poses of frames.
    "tf2_msgs/TFMessage" Transforms {
        /// One a frame.
        transforms: Vec<TransformStamped>,
    }
    /// A text.
    "std_msgs/String" Text {
        /// The text.
        data: String,
    }
    /// One truth value.
    "std_msgs/Bool" Bool {
        /// The value.
        data: bool,
    }
}

/// A covariance matrix, row-major.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "Vec<f64>", try_from = "Vec<f64>")]
pub struct Covariance<const N: usize>(pub [f64; N]);

impl<const N: usize> Default for Covariance<N> {
    fn default() -> Self {
        Self([0.0; N])
    }
}

impl<const N: usize> From<Covariance<N>> for Vec<f64> {
    fn from(covariance: Covariance<N>) -> Self {
        covariance.0.to_vec()
    }
}

impl<const N: usize> TryFrom<Vec<f64>> for Covariance<N> {
    type Error = String;

    fn try_from(values: Vec<f64>) -> Result<Self, String> {
        let wrong = |values: Vec<f64>| format!("a covariance has {N} entries, this one {}", values.len());
        values.try_into().map(Self).map_err(wrong)
    }
}

impl<const N: usize> Field for Covariance<N> {
    fn type_name() -> String {
        <[f64; N]>::type_name()
    }
    fn define(_: &mut Vec<(String, String)>) {}
    fn encode(&self, encoder: &mut Encoder) {
        self.0.encode(encoder);
    }
    fn decode(decoder: &mut Decoder<'_>) -> Result<Self, String> {
        Field::decode(decoder).map(Self)
    }
}

/// What the policy saw and did in one step; simulation only.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PolicyStep {
    /// The observation as the network got it, before normalisation.
    pub observation: Vec<f64>,
    /// The action in [0, 1] per policy joint.
    pub action: Vec<f64>,
    /// Reward terms by name.
    pub reward: Map<String, Value>,
}

impl Time {
    /// The time `nanoseconds` after zero.
    pub fn from_nanoseconds(nanoseconds: u64) -> Self {
        const SECOND: u64 = 1_000_000_000;
        let sec = i32::try_from(nanoseconds / SECOND).unwrap_or(i32::MAX);
        Self {
            sec,
            nanosec: (nanoseconds % SECOND) as u32,
        }
    }

    /// Nanoseconds after zero; zero for a time before it.
    pub fn nanoseconds(&self) -> u64 {
        u64::try_from(self.sec).unwrap_or(0) * 1_000_000_000 + u64::from(self.nanosec)
    }
}

impl Header {
    /// A header stamped `nanoseconds` after zero in frame `frame_id`.
    pub fn new(nanoseconds: u64, frame_id: &str) -> Self {
        Self {
            stamp: Time::from_nanoseconds(nanoseconds),
            frame_id: frame_id.to_owned(),
        }
    }
}
