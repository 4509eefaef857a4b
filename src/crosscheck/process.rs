//! A Python process that answers requests over its pipes, by `python/omniwalk_reference/server.py`.

use std::io::{self, BufReader, BufWriter, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde_json::Value;

use super::python::Python;

/// Longest reply that is taken, bytes.
const LONGEST_REPLY: u32 = 1 << 30;

/// The process. It ends when this is dropped.
pub struct Process {
    child: Child,
    requests: Option<BufWriter<ChildStdin>>,
    replies: BufReader<ChildStdout>,
    reply: Vec<u8>,
}

impl Process {
    /// Starts one.
    ///
    /// # Errors
    /// When the system cannot.
    pub fn start(python: &Python) -> Result<Self, String> {
        let mut child = python
            .server(&mut Command::new(python.program()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| format!("cannot start {}: {error}", python.program().display()))?;
        let (Some(requests), Some(replies)) = (child.stdin.take(), child.stdout.take()) else {
            return Err("a process without pipes".into());
        };
        Ok(Self {
            child,
            requests: Some(BufWriter::new(requests)),
            replies: BufReader::new(replies),
            reply: Vec::new(),
        })
    }

    /// Asks `letter` with `head` as JSON and `rest` after it.
    ///
    /// # Errors
    /// As [`Process::ask`].
    pub fn ask_with_head(&mut self, letter: u8, head: &Value, rest: &[u8]) -> Result<&[u8], String> {
        let head = head.to_string();
        let mut payload = Vec::with_capacity(4 + head.len() + rest.len());
        payload.extend((head.len() as u32).to_le_bytes());
        payload.extend(head.bytes());
        payload.extend(rest);
        self.ask(letter, &payload)
    }

    /// Asks `letter` with `payload` and waits for the reply.
    ///
    /// # Errors
    /// What the process says is wrong, or that it is gone.
    pub fn ask(&mut self, letter: u8, payload: &[u8]) -> Result<&[u8], String> {
        match self.exchange(letter, payload) {
            Ok(0) => Ok(&self.reply),
            Ok(_) => Err(String::from_utf8_lossy(&self.reply).into_owned()),
            Err(error) => Err(format!("MuJoCo's process is gone: {error}")),
        }
    }

    fn exchange(&mut self, letter: u8, payload: &[u8]) -> io::Result<u8> {
        let requests = self.requests.as_mut().ok_or(io::ErrorKind::BrokenPipe)?;
        requests.write_all(&[letter])?;
        requests.write_all(&(payload.len() as u32).to_le_bytes())?;
        requests.write_all(payload)?;
        requests.flush()?;
        let mut header = [0; 5];
        self.replies.read_exact(&mut header)?;
        let [status, length @ ..] = header;
        let length = u32::from_le_bytes(length);
        if length > LONGEST_REPLY {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "a reply of over a gigabyte"));
        }
        self.reply.resize(length as usize, 0);
        self.replies.read_exact(&mut self.reply)?;
        Ok(status)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // A closed pipe is its end; one that hangs is ended.
        self.requests = None;
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Numbers as the process takes them.
pub fn bytes(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
}

/// Numbers of a reply.
pub fn numbers(bytes: &[u8]) -> impl Iterator<Item = f64> + '_ {
    bytes.as_chunks().0.iter().map(|chunk| f64::from_le_bytes(*chunk))
}
