//! Control packets (GVCP): what a client asks and how it is answered.

/// First byte of every command.
const KEY: u8 = 0x42;
/// Bytes of a header.
pub(crate) const HEADER: usize = 8;
/// Most bytes after a header.
const MOST_PAYLOAD: usize = 540;

/// Why a command is not carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub(crate) enum Status {
    NotImplemented = 0x8001,
    InvalidParameter = 0x8002,
    InvalidAddress = 0x8003,
    WriteProtect = 0x8004,
    BadAlignment = 0x8005,
    AccessDenied = 0x8006,
    InvalidHeader = 0x800e,
}

/// A command and what comes with it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Command {
    Discovery,
    ReadRegisters(Vec<u32>),
    WriteRegisters(Vec<(u32, u32)>),
    ReadMemory {
        address: u32,
        bytes: usize,
    },
    WriteMemory {
        address: u32,
        bytes: Vec<u8>,
    },
    /// Packets `first..=last` of a block.
    Resend {
        block: u16,
        first: u32,
        last: u32,
    },
}

/// A packet that is a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Request {
    /// The command, or why it cannot be one.
    pub(crate) command: Result<Command, Status>,
    code: u16,
    id: u16,
    wants_answer: bool,
}

const DISCOVERY: u16 = 0x0002;
const FORCE_IP: u16 = 0x0004;
const RESEND: u16 = 0x0040;
const READ_REGISTERS: u16 = 0x0080;
const WRITE_REGISTERS: u16 = 0x0082;
const READ_MEMORY: u16 = 0x0084;
const WRITE_MEMORY: u16 = 0x0086;

fn word(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |value, &byte| value << 8 | u32::from(byte))
}

impl Request {
    /// Reads a packet; `None` where it is no command, or one that is not answered by the standard.
    pub(crate) fn read(packet: &[u8]) -> Option<Self> {
        let (header, payload) = packet.split_at_checked(HEADER)?;
        let half = |at: usize| word(&header[at..at + 2]) as u16;
        let (flags, code, length, id) = (header[1], half(2), usize::from(half(4)), half(6));
        // FORCEIP is for a device whose address is not reached: this one's address is the machine's.
        if header[0] != KEY || id == 0 || code == FORCE_IP {
            return None;
        }
        let command = if length != payload.len() || length > MOST_PAYLOAD {
            Err(Status::InvalidHeader)
        } else {
            Self::command(code, payload)
        };
        Some(Self { command, code, id, wants_answer: flags & 1 != 0 && code != RESEND })
    }

    fn command(code: u16, payload: &[u8]) -> Result<Command, Status> {
        let whole = |size: usize| !payload.is_empty() && payload.len().is_multiple_of(size);
        let invalid = |good: bool| if good { Ok(()) } else { Err(Status::InvalidHeader) };
        match code {
            DISCOVERY => invalid(payload.is_empty()).map(|()| Command::Discovery),
            READ_REGISTERS => {
                invalid(whole(4))?;
                Ok(Command::ReadRegisters(payload.chunks_exact(4).map(word).collect()))
            }
            WRITE_REGISTERS => {
                invalid(whole(8))?;
                let pairs = payload.chunks_exact(8);
                Ok(Command::WriteRegisters(pairs.map(|pair| (word(&pair[..4]), word(&pair[4..]))).collect()))
            }
            READ_MEMORY => {
                invalid(payload.len() == 8)?;
                let bytes = word(&payload[6..]) as usize;
                if bytes == 0 || !bytes.is_multiple_of(4) {
                    return Err(Status::BadAlignment);
                }
                if bytes > MOST_PAYLOAD - 4 {
                    return Err(Status::InvalidParameter);
                }
                Ok(Command::ReadMemory { address: word(&payload[..4]), bytes })
            }
            WRITE_MEMORY => {
                invalid(payload.len() > 4)?;
                if !payload.len().is_multiple_of(4) {
                    return Err(Status::BadAlignment);
                }
                Ok(Command::WriteMemory { address: word(&payload[..4]), bytes: payload[4..].to_vec() })
            }
            RESEND => {
                invalid(payload.len() == 12)?;
                let (first, last) = (word(&payload[4..8]) & 0xff_ffff, word(&payload[8..]) & 0xff_ffff);
                Ok(Command::Resend { block: word(&payload[2..4]) as u16, first, last })
            }
            _ => Err(Status::NotImplemented),
        }
    }

    /// What makes two packets of one sender the same request, sent again.
    pub(crate) fn identity(&self) -> (u16, u16) {
        (self.code, self.id)
    }

    /// The packet that answers it; `None` where none is wanted.
    pub(crate) fn answer(&self, result: Result<Vec<u8>, Status>) -> Option<Vec<u8>> {
        if !self.wants_answer {
            return None;
        }
        let (status, payload) = match result {
            Ok(payload) => (0, payload),
            Err(status) => (status as u16, Vec::new()),
        };
        let mut packet = Vec::with_capacity(HEADER + payload.len());
        for half in [status, self.code | 1, payload.len() as u16, self.id] {
            packet.extend(half.to_be_bytes());
        }
        packet.extend(payload);
        Some(packet)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(code: u16, payload: &[u8]) -> Vec<u8> {
        let mut bytes = vec![KEY, 1];
        for half in [code, payload.len() as u16, 7] {
            bytes.extend(half.to_be_bytes());
        }
        bytes.extend(payload);
        bytes
    }

    #[test]
    fn commands_are_read_and_answered() {
        let request = Request::read(&packet(READ_REGISTERS, &[0, 0, 0x0a, 0])).unwrap();
        assert_eq!(request.command, Ok(Command::ReadRegisters(vec![0xa00])));
        assert_eq!(request.answer(Ok(vec![1, 2, 3, 4])).unwrap(), [0, 0, 0, 0x81, 0, 4, 0, 7, 1, 2, 3, 4]);
        assert_eq!(request.answer(Err(Status::AccessDenied)).unwrap(), [0x80, 6, 0, 0x81, 0, 0, 0, 7]);
        let memory = Request::read(&packet(READ_MEMORY, &[0, 0, 2, 0, 0, 0, 2, 0])).unwrap();
        assert_eq!(memory.command, Ok(Command::ReadMemory { address: 0x200, bytes: 512 }));
        let resend = Request::read(&packet(RESEND, &[0, 0, 0, 9, 0, 0, 0, 3, 0, 0, 0, 5])).unwrap();
        assert_eq!(resend.command, Ok(Command::Resend { block: 9, first: 3, last: 5 }));
        assert_eq!(resend.answer(Ok(Vec::new())), None);
    }

    #[test]
    fn what_is_no_command_is_not_answered_or_refused() {
        assert_eq!(Request::read(&[0x42, 1, 0]), None);
        assert_eq!(Request::read(&[0x41, 1, 0, 2, 0, 0, 0, 1]), None);
        assert_eq!(Request::read(&[0x42, 1, 0, 2, 0, 0, 0, 0]), None);
        let refused =
            |code, payload: &[u8]| Request::read(&packet(code, payload)).unwrap().command.unwrap_err();
        assert_eq!(refused(0x7777, &[]), Status::NotImplemented);
        assert_eq!(refused(READ_REGISTERS, &[1, 2, 3]), Status::InvalidHeader);
        assert_eq!(refused(READ_MEMORY, &[0, 0, 0, 0, 0, 0, 0, 3]), Status::BadAlignment);
        assert_eq!(refused(READ_MEMORY, &[0, 0, 0, 0, 0, 0, 0x0f, 0]), Status::InvalidParameter);
        let mut torn = packet(WRITE_REGISTERS, &[0; 8]);
        torn.pop();
        assert_eq!(Request::read(&torn).unwrap().command, Err(Status::InvalidHeader));
    }
}
