//! As much of ZeroMQ's protocol as a REP socket needs (ZMTP 3.0, rfc.zeromq.org/spec/23; REQ and REP: spec/28), with limits:
//! who connects has to be taken for a stranger.

use std::io::{Error, ErrorKind, Read as _, Write as _};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How often a wait looks whether it is to end.
const BEAT: Duration = Duration::from_millis(50);
/// A client that says less than a greeting within this is none.
const GREETING_TIME: Duration = Duration::from_secs(5);
const PATIENCE: Duration = Duration::from_secs(10);
/// Largest message, bytes, and its most parts: a simulation's state has some kilobytes.
const LARGEST_MESSAGE: u64 = 16 << 20;
const MOST_PARTS: usize = 64;
/// Bits of a frame's first byte.
const MORE: u8 = 1;
const LONG: u8 = 2;
const COMMAND: u8 = 4;
const GREETING: usize = 64;

/// The connection of one REQ socket.
pub(crate) struct Connection<'s> {
    stream: TcpStream,
    stop: &'s AtomicBool,
}

fn refused(why: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidData, why.into())
}

impl<'s> Connection<'s> {
    /// Greets a client.
    pub(crate) fn open(stream: TcpStream, stop: &'s AtomicBool) -> std::io::Result<Self> {
        stream.set_nonblocking(false)?;
        stream.set_read_timeout(Some(BEAT))?;
        // A client that takes nothing for so long is gone.
        stream.set_write_timeout(Some(PATIENCE))?;
        stream.set_nodelay(true)?;
        let mut out = Self { stream, stop };
        let mut greeting = [0; GREETING];
        (greeting[0], greeting[9], greeting[10]) = (0xff, 0x7f, 3);
        greeting[12..16].copy_from_slice(b"NULL");
        out.stream.write_all(&greeting)?;
        let until = Some(Instant::now() + GREETING_TIME);
        let mut theirs = [0; GREETING];
        out.read(&mut theirs, until)?;
        if theirs[0] != 0xff || theirs[9] & 1 == 0 || theirs[10] < 3 {
            return Err(refused("this is no ZeroMQ socket of protocol 3"));
        }
        if &theirs[12..17] != b"NULL\0" {
            return Err(refused("the client wants a secured connection"));
        }
        let ready = b"\x05READY\x0bSocket-Type\x00\x00\x00\x03REP";
        out.send_frame(COMMAND, ready)?;
        let (flags, answer) = out.frame(LARGEST_MESSAGE, until)?;
        if flags & COMMAND == 0 || !answer.starts_with(b"\x05READY") {
            return Err(refused("the client does not say that it is ready"));
        }
        Ok(out)
    }

    /// The next request's parts, without what leads back to its sender.
    pub(crate) fn receive(&mut self) -> std::io::Result<Vec<Vec<u8>>> {
        let mut parts: Vec<Vec<u8>> = Vec::new();
        let mut left = LARGEST_MESSAGE;
        loop {
            let (flags, body) = self.frame(left, None)?;
            if flags & COMMAND != 0 {
                continue;
            }
            left -= body.len() as u64;
            parts.push(body);
            if flags & MORE == 0 {
                break;
            }
            if parts.len() == MOST_PARTS {
                return Err(refused(format!("a request has more than {MOST_PARTS} parts")));
            }
        }
        if parts.len() < 2 || !parts[0].is_empty() {
            return Err(refused("a request of another kind than a REQ socket's"));
        }
        parts.remove(0);
        Ok(parts)
    }

    /// Answers the request that was received last.
    pub(crate) fn send(&mut self, parts: &[Vec<u8>]) -> std::io::Result<()> {
        self.send_frame(MORE, &[])?;
        for (at, part) in parts.iter().enumerate() {
            self.send_frame(if at + 1 < parts.len() { MORE } else { 0 }, part)?;
        }
        Ok(())
    }

    fn send_frame(&mut self, flags: u8, body: &[u8]) -> std::io::Result<()> {
        match u8::try_from(body.len()) {
            Ok(size) => self.stream.write_all(&[flags, size])?,
            Err(_) => {
                self.stream.write_all(&[flags | LONG])?;
                self.stream.write_all(&(body.len() as u64).to_be_bytes())?;
            }
        }
        self.stream.write_all(body)
    }

    /// A frame's first byte and its body.
    fn frame(&mut self, largest: u64, until: Option<Instant>) -> std::io::Result<(u8, Vec<u8>)> {
        let [flags] = self.array(until)?;
        if flags & !(MORE | LONG | COMMAND) != 0 {
            return Err(refused("a frame of an unknown kind"));
        }
        let size = if flags & LONG != 0 {
            u64::from_be_bytes(self.array(until)?)
        } else {
            u64::from(self.array::<1>(until)?[0])
        };
        if size > largest {
            return Err(refused(format!("a request has more than {LARGEST_MESSAGE} bytes")));
        }
        // Within the limit, and grown as bytes come.
        let mut body = Vec::new();
        let mut part = [0; 1 << 14];
        while (body.len() as u64) < size {
            let next = (size - body.len() as u64).min(part.len() as u64) as usize;
            self.read(&mut part[..next], until)?;
            body.extend_from_slice(&part[..next]);
        }
        Ok((flags, body))
    }

    fn array<const N: usize>(&mut self, until: Option<Instant>) -> std::io::Result<[u8; N]> {
        let mut out = [0; N];
        self.read(&mut out, until)?;
        Ok(out)
    }

    /// Fills a buffer. Waits as long as it takes, or `until`, or until the program is to end.
    fn read(&mut self, buffer: &mut [u8], until: Option<Instant>) -> std::io::Result<()> {
        let mut at = 0;
        while at < buffer.len() {
            if self.stop.load(Ordering::Acquire) {
                return Err(Error::new(ErrorKind::Interrupted, "the program ends"));
            }
            if until.is_some_and(|until| Instant::now() > until) {
                return Err(Error::new(ErrorKind::TimedOut, "the client does not greet"));
            }
            match self.stream.read(&mut buffer[at..]) {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(count) => at += count,
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                    ) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}
