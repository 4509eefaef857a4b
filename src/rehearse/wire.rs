//! What robot and controller send each other: datagrams of little-endian numbers, one a reading or command.
//!
//! The two run in processes of one machine and tell time by its monotonic clock, so that the age of a reading is known.

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixDatagram;

use omniwalk_controller::{MAX_JOINTS, Sensors};

/// Longest datagram: header and two numbers for each joint.
const LONGEST: usize = 128 + 8 * MAX_JOINTS;

/// What the robot measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    /// Number of the reading.
    pub sequence: u64,
    /// When it was measured, ns.
    pub time: u64,
    /// Desired velocity, m/s, m/s, rad/s.
    pub desired: [f32; 3],
    /// Fused roll and pitch, rad.
    pub attitude: [f32; 2],
    /// Angular velocity of the base, rad/s.
    pub gyro: [f32; 3],
    /// Joint positions, rad or m.
    pub position: Vec<f32>,
    /// Joint velocities, rad/s or m/s.
    pub velocity: Vec<f32>,
}

/// What the controller wants.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Commanded {
    /// Number of the reading it is based on.
    pub sequence: u64,
    /// How long the step took, ns.
    pub duration: u64,
    /// How late the step was, s.
    pub late: f32,
    /// [`omniwalk_controller::Mode`] as a number.
    pub mode: u32,
    /// 0, or one more than the number of the fault.
    pub fault: u32,
    /// Whether an observation was out of the range of training.
    pub out_of_range: u32,
    /// Estimated velocity of the base in the base frame, m/s.
    pub velocity: [f32; 3],
    /// Joint targets, rad or m.
    pub targets: Vec<f32>,
}

/// A message as bytes.
pub trait Datagram: Sized {
    /// Writes it.
    fn encode(&self, out: &mut Vec<u8>);
    /// Reads it; `None` if the bytes are not one.
    fn decode(from: Bytes) -> Option<Self>;
}

/// Bytes that are still to be read.
pub struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (number, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*number)
    }

    fn long(&mut self) -> Option<u64> {
        self.number().map(u64::from_le_bytes)
    }

    fn word(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    fn float(&mut self) -> Option<f32> {
        self.number().map(f32::from_le_bytes)
    }

    fn floats<const N: usize>(&mut self) -> Option<[f32; N]> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = self.float()?;
        }
        Some(numbers)
    }

    /// A number for each joint, to the end.
    fn joints(&mut self) -> Option<Vec<f32>> {
        let count = self.word()? as usize;
        if count > MAX_JOINTS {
            return None;
        }
        (0..count).map(|_| self.float()).collect()
    }
}

fn put(out: &mut Vec<u8>, numbers: &[f32]) {
    numbers.iter().for_each(|x| out.extend_from_slice(&x.to_le_bytes()));
}

fn put_joints(out: &mut Vec<u8>, numbers: &[f32]) {
    out.extend_from_slice(&(numbers.len() as u32).to_le_bytes());
    put(out, numbers);
}

impl Datagram for Measured {
    fn encode(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.sequence.to_le_bytes());
        out.extend_from_slice(&self.time.to_le_bytes());
        put(out, &self.desired);
        put(out, &self.attitude);
        put(out, &self.gyro);
        put_joints(out, &self.position);
        put_joints(out, &self.velocity);
    }

    fn decode(mut from: Bytes) -> Option<Self> {
        let message = Self {
            sequence: from.long()?,
            time: from.long()?,
            desired: from.floats()?,
            attitude: from.floats()?,
            gyro: from.floats()?,
            position: from.joints()?,
            velocity: from.joints()?,
        };
        from.0.is_empty().then_some(message)
    }
}

impl Measured {
    /// As the controller takes them.
    pub fn sensors(&self) -> Sensors<'_> {
        Sensors {
            position: &self.position,
            velocity: &self.velocity,
            attitude: self.attitude,
            gyro: self.gyro,
            base_velocity: None,
        }
    }
}

impl Datagram for Commanded {
    fn encode(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.sequence.to_le_bytes());
        out.extend_from_slice(&self.duration.to_le_bytes());
        put(out, &[self.late]);
        for word in [self.mode, self.fault, self.out_of_range] {
            out.extend_from_slice(&word.to_le_bytes());
        }
        put(out, &self.velocity);
        put_joints(out, &self.targets);
    }

    fn decode(mut from: Bytes) -> Option<Self> {
        let message = Self {
            sequence: from.long()?,
            duration: from.long()?,
            late: from.float()?,
            mode: from.word()?,
            fault: from.word()?,
            out_of_range: from.word()?,
            velocity: from.floats()?,
            targets: from.joints()?,
        };
        from.0.is_empty().then_some(message)
    }
}

/// The process at the other end has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gone;

/// One end of the connection. Neither sending nor receiving waits; what the other end does not take is lost, as on a bus.
///
/// The two ends are nowhere but in their processes: nothing is left behind, however these end.
pub struct Line {
    socket: UnixDatagram,
    buffer: Vec<u8>,
}

impl Line {
    /// A line's two ends: of this process, and for another one.
    ///
    /// # Errors
    /// What the system says.
    pub fn pair() -> io::Result<(Self, OwnedFd)> {
        let (own, other) = UnixDatagram::pair()?;
        Ok((Self::new(own.into())?, other.into()))
    }

    /// The end that another process gave to this one.
    ///
    /// # Errors
    /// When it is not one.
    pub fn new(end: OwnedFd) -> io::Result<Self> {
        let socket = UnixDatagram::from(end);
        socket.set_nonblocking(true)?;
        Ok(Self {
            socket,
            buffer: Vec::with_capacity(LONGEST),
        })
    }

    /// Sends a message, which may be lost.
    ///
    /// # Errors
    /// When there is no other end any more.
    pub fn send(&mut self, message: &impl Datagram) -> Result<(), Gone> {
        self.buffer.clear();
        message.encode(&mut self.buffer);
        match self.socket.send(&self.buffer) {
            Err(error) if error.kind() != io::ErrorKind::WouldBlock => Err(Gone),
            _ => Ok(()),
        }
    }

    /// The next message that has come, if any; what is none is passed over.
    pub fn receive<T: Datagram>(&mut self) -> Option<T> {
        let mut bytes = [0; LONGEST];
        loop {
            let len = self.socket.recv(&mut bytes).ok()?;
            if let Some(message) = T::decode(Bytes(&bytes[..len])) {
                return Some(message);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_arrive_as_they_were_sent_and_noise_is_passed_over() {
        let (mut robot, other) = Line::pair().unwrap();
        let mut controller = Line::new(other).unwrap();
        let measured = Measured {
            sequence: 7,
            time: u64::MAX,
            desired: [0.1, 0.2, 0.3],
            attitude: [0.4, f32::INFINITY],
            gyro: [0.5; 3],
            position: vec![1.0; MAX_JOINTS],
            velocity: vec![2.0; MAX_JOINTS],
        };
        assert_eq!(controller.receive::<Measured>(), None);
        robot.socket.send(&[0xff; 90]).unwrap();
        robot.socket.send(&[]).unwrap();
        assert_eq!(robot.send(&measured), Ok(()));
        assert_eq!(controller.receive(), Some(measured));
        let commanded = Commanded {
            sequence: 7,
            duration: 12_000,
            late: 0.01,
            mode: 1,
            fault: 2,
            out_of_range: 1,
            velocity: [0.1, 0.0, 0.0],
            targets: vec![0.5; 18],
        };
        assert_eq!(controller.send(&commanded), Ok(()));
        assert_eq!(robot.receive(), Some(commanded.clone()));
        // What the other end does not take is lost; an end without another one is told.
        assert!((0..10_000).all(|_| controller.send(&commanded) == Ok(())));
        drop(robot);
        assert_eq!(controller.send(&commanded), Err(Gone));
    }
}
