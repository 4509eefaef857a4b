//! Column maps and the CSV, JSON or MCAP they are for: the map, a line `---`, the file.

use omniwalk_env::robot::Source;
use omniwalk_sim2real::recording::{Map, read};

use super::log::sound;
use super::scratch::with_file;

const LINE: &[u8] = b"\n---\n";

/// Reads what is behind the line through the map before it.
pub fn check(data: &[u8]) {
    let at = data.windows(LINE.len()).position(|window| window == LINE);
    let (map, file) = at.map_or((data, &[][..]), |at| (&data[..at], &data[at + LINE.len()..]));
    let Ok(text) = String::from_utf8(map.to_vec()) else {
        return;
    };
    let file_name = "map.toml".to_owned();
    let Ok(map) = Map::parse(&Source { file: file_name, text }) else {
        return;
    };
    let ending = match file.first() {
        Some(b'{' | b'[') => "json",
        _ => "csv",
    };
    if let Ok(recordings) = with_file(ending, file, |path| read(path, Some(&map))) {
        sound(&recordings);
    }
}
