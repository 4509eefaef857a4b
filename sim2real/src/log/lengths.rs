//! Lengths in MCAP records. The library sets aside as much as a text's length claims before it looks whether so much is there: four bytes
//! ask for four gigabytes. So lengths are looked at first.

use mcap::records::op;

/// Whether every text of a record that is parsed lies within it.
pub(super) fn fit(opcode: u8, data: &[u8]) -> bool {
    let walked = match opcode {
        op::SCHEMA => skip(data, 2).and_then(text).and_then(text),
        op::CHANNEL => skip(data, 4).and_then(text).and_then(text).and_then(map),
        op::METADATA => text(data).and_then(map),
        _ => Some(data),
    };
    walked.is_some()
}

fn skip(data: &[u8], bytes: usize) -> Option<&[u8]> {
    data.get(bytes..)
}

/// What is behind a length and as many bytes.
fn text(data: &[u8]) -> Option<&[u8]> {
    let (length, rest) = data.split_first_chunk()?;
    skip(rest, u32::from_le_bytes(*length) as usize)
}

/// What is behind a length in bytes and pairs of texts.
fn map(data: &[u8]) -> Option<&[u8]> {
    let (length, rest) = data.split_first_chunk()?;
    let (mut pairs, behind) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    while !pairs.is_empty() {
        pairs = text(pairs).and_then(text)?;
    }
    Some(behind)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(text: &str) -> Vec<u8> {
        [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
    }

    /// Found by a mutation of a log: 2.6 GB were set aside for `robot_overrides`.
    #[test]
    fn a_text_that_claims_gigabytes_is_not_believed() {
        let pairs = [text("payload.mass"), text("0.5")].concat();
        let whole = [
            text("robot_overrides"),
            (pairs.len() as u32).to_le_bytes().to_vec(),
            pairs,
        ]
        .concat();
        assert!(fit(op::METADATA, &whole));
        for at in [0, 19, 23, 39] {
            let mut claimed = whole.clone();
            claimed[at + 3] = 0x9f;
            assert!(!fit(op::METADATA, &claimed), "{at}");
        }
        assert!(!fit(op::CHANNEL, &whole[..3]));
        assert!(!fit(op::SCHEMA, &[0, 0, 1, 0, 0, 0x9f]));
    }
}
