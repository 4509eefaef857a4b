//! Counter-based randomness: one stream per seed, environment and episode, so that what an environment draws
//! does not depend on how many others there are or which thread steps them.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// The random stream of one episode of one environment.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(from = "Position", into = "Position")]
pub struct Stream {
    seed: u64,
    environment: u64,
    episode: u64,
    generator: ChaCha8Rng,
}

/// What a checkpoint keeps of a stream.
#[derive(Serialize, Deserialize)]
struct Position {
    seed: u64,
    environment: u64,
    episode: u64,
    word: u128,
}

impl Stream {
    /// The stream of `episode` of `environment` at its beginning.
    pub fn new(seed: u64, environment: u64, episode: u64) -> Self {
        let mut key = [0; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8..16].copy_from_slice(&environment.to_le_bytes());
        key[16..24].copy_from_slice(&episode.to_le_bytes());
        Self {
            seed,
            environment,
            episode,
            generator: ChaCha8Rng::from_seed(key),
        }
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.generator.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform between `lower` and `upper`.
    pub fn uniform(&mut self, lower: f64, upper: f64) -> f64 {
        lower + (upper - lower) * self.unit()
    }

    /// Normal with mean zero.
    pub fn normal(&mut self, deviation: f64) -> f64 {
        let z: f64 = StandardNormal.sample(&mut self.generator);
        deviation * z
    }
}

impl From<Position> for Stream {
    fn from(p: Position) -> Self {
        let mut stream = Self::new(p.seed, p.environment, p.episode);
        stream.generator.set_word_pos(p.word);
        stream
    }
}

impl From<Stream> for Position {
    fn from(s: Stream) -> Self {
        Self {
            seed: s.seed,
            environment: s.environment,
            episode: s.episode,
            word: s.generator.get_word_pos(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_saved_in_the_middle_goes_on_with_the_same_numbers() {
        let mut stream = Stream::new(1, 2, 3);
        for _ in 0..13 {
            stream.normal(1.0);
        }
        let bytes = postcard::to_stdvec(&stream).unwrap();
        let mut restored: Stream = postcard::from_bytes(&bytes).unwrap();
        for _ in 0..100 {
            assert_eq!(stream.unit().to_bits(), restored.unit().to_bits());
            assert_eq!(stream.normal(2.0).to_bits(), restored.normal(2.0).to_bits());
        }
    }

    #[test]
    fn streams_of_other_environments_and_episodes_differ() {
        let first = |s, e, k| Stream::new(s, e, k).unit();
        let reference = first(1, 2, 3);
        assert!(
            [first(2, 2, 3), first(1, 3, 3), first(1, 2, 4)]
                .iter()
                .all(|&x| x != reference)
        );
    }
}
