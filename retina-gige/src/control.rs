//! The device's state, and how control packets read and change it.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::{Duration, Instant};

use crate::description::description;
use crate::features::{Access, FIRST, Feature, Id, KNOBS, Kind, STRIDE, Settings, Value, table};
use crate::imager::CameraInfo;
use crate::packet::{Command, Request, Status};
use crate::registers::{self, Bootstrap};

/// Address of the description.
const DESCRIPTION: u32 = 0x10_0000;
/// Triggers that wait: one beside the exposure that is made.
const MOST_TRIGGERS: u32 = 1;
const EXCLUSIVE: u32 = 1;
const CONTROL: u32 = 2;

/// Who controls the device.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Controller {
    address: SocketAddr,
    exclusive: bool,
    heard: Instant,
}

/// What a packet asks for beyond its answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Action {
    Resend { block: u16, first: u32, last: u32 },
    TestPacket,
}

/// What comes of a packet.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Outcome {
    pub(crate) answer: Option<Vec<u8>>,
    pub(crate) action: Option<Action>,
}

/// An acquisition under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Acquisition {
    /// Tells it from earlier ones.
    pub(crate) number: u64,
    /// Images still to take; `None` where it does not end by itself.
    pub(crate) left: Option<u32>,
}

#[derive(Debug)]
pub(crate) struct Control {
    info: CameraInfo,
    features: Vec<Feature>,
    description: Vec<u8>,
    start: Instant,
    pub(crate) bootstrap: Bootstrap,
    pub(crate) settings: Settings,
    pub(crate) temperature_c: f64,
    pub(crate) acquisition: Option<Acquisition>,
    pub(crate) triggers: u32,
    acquisitions: u64,
    controller: Option<Controller>,
    /// The last request that was answered: a client that has not heard the answer sends it again.
    last: Option<(SocketAddr, (u16, u16), Outcome)>,
}

impl Control {
    pub(crate) fn new(info: &CameraInfo, address: Ipv4Addr, stream_port: u16, start: Instant) -> Self {
        let features = table(info);
        let text = description(info, &features);
        let url = format!("Local:retina.xml;{DESCRIPTION:X};{:X}", text.len());
        let mut description = text.into_bytes();
        // Clients read whole words, and some the whole last packet.
        description.resize(description.len().next_multiple_of(1024), b'\n');
        Self {
            info: info.clone(),
            features,
            description,
            start,
            bootstrap: Bootstrap::new(info, address, stream_port, &url),
            settings: Settings::new(info),
            temperature_c: 20.0,
            acquisition: None,
            triggers: 0,
            acquisitions: 0,
            controller: None,
            last: None,
        }
    }

    /// Where images go; `None` while nobody has opened the stream.
    pub(crate) fn destination(&self) -> Option<SocketAddr> {
        let address = Ipv4Addr::from(self.bootstrap.get(registers::STREAM_ADDRESS));
        let port = self.bootstrap.get(registers::STREAM_PORT) as u16;
        (port != 0 && !address.is_unspecified()).then(|| SocketAddr::new(IpAddr::V4(address), port))
    }

    /// Time since the start, ticks.
    pub(crate) fn ticks(&self, now: Instant) -> u64 {
        now.duration_since(self.start).as_nanos() as u64
    }

    /// Who controls the device.
    pub(crate) fn controller(&self) -> Option<SocketAddr> {
        self.controller.map(|controller| controller.address)
    }

    /// Lets a controller go that has not been heard for longer than it said.
    pub(crate) fn release_silent(&mut self, now: Instant) {
        let limit = Duration::from_millis(self.bootstrap.heartbeat_ms().into());
        if self.controller.is_some_and(|controller| now.duration_since(controller.heard) > limit) {
            self.release();
        }
    }

    /// Nobody controls the device: it takes no images and sends nothing.
    fn release(&mut self) {
        self.controller = None;
        self.bootstrap.set_controller(0, Ipv4Addr::UNSPECIFIED, 0);
        self.bootstrap.set(registers::STREAM_PORT, 0);
        self.stop();
    }

    /// Ends the acquisition.
    pub(crate) fn stop(&mut self) {
        self.acquisition = None;
        self.triggers = 0;
    }

    /// Answers a packet. `only_discovery` where it came to a broadcast address.
    pub(crate) fn handle(
        &mut self,
        packet: &[u8],
        from: SocketAddr,
        only_discovery: bool,
        now: Instant,
    ) -> Outcome {
        self.release_silent(now);
        let Some(request) = Request::read(packet) else { return Outcome::default() };
        if only_discovery && request.command != Ok(Command::Discovery) {
            return Outcome::default();
        }
        if let Some(controller) = self.controller.as_mut().filter(|controller| controller.address == from) {
            controller.heard = now;
        }
        let identity = request.identity();
        let resend = matches!(request.command, Ok(Command::Resend { .. }));
        if !resend
            && let Some((address, known, outcome)) = &self.last
            && (*address, *known) == (from, identity)
        {
            return Outcome { answer: outcome.answer.clone(), action: None };
        }
        let mut action = None;
        let result = match request.command.clone() {
            Err(status) => Err(status),
            Ok(command) => self.carry_out(command, from, now, &mut action),
        };
        let outcome = Outcome { answer: request.answer(result), action };
        if !resend {
            self.last = Some((from, identity, outcome.clone()));
        }
        outcome
    }

    fn carry_out(
        &mut self,
        command: Command,
        from: SocketAddr,
        now: Instant,
        action: &mut Option<Action>,
    ) -> Result<Vec<u8>, Status> {
        match command {
            Command::Discovery => Ok(self.bootstrap.bytes()[..registers::DISCOVERY].to_vec()),
            Command::ReadRegisters(addresses) => {
                let mut values = Vec::with_capacity(4 * addresses.len());
                for address in addresses {
                    self.may_read(address, from)?;
                    values.extend(self.read(address, 4)?);
                }
                Ok(values)
            }
            Command::ReadMemory { address, bytes } => {
                self.may_read(address, from)?;
                let mut answer = address.to_be_bytes().to_vec();
                answer.extend(self.read(address, bytes)?);
                Ok(answer)
            }
            Command::WriteRegisters(pairs) => {
                for (address, word) in &pairs {
                    self.write(*address, &word.to_be_bytes(), from, now, action)?;
                }
                Ok(vec![0, 0, (pairs.len() >> 8) as u8, pairs.len() as u8])
            }
            Command::WriteMemory { address, bytes } => {
                self.write(address, &bytes, from, now, action)?;
                Ok(vec![0, 0, (bytes.len() >> 8) as u8, bytes.len() as u8])
            }
            Command::Resend { block, first, last } => {
                // To the stream's own address only, whoever asks.
                *action = Some(Action::Resend { block, first, last });
                Ok(Vec::new())
            }
        }
    }

    fn may_read(&self, address: u32, from: SocketAddr) -> Result<(), Status> {
        let shut =
            self.controller.is_some_and(|controller| controller.exclusive && controller.address != from);
        if shut && address != registers::PRIVILEGE { Err(Status::AccessDenied) } else { Ok(()) }
    }

    /// The bytes at an address.
    fn read(&self, address: u32, count: usize) -> Result<Vec<u8>, Status> {
        if !address.is_multiple_of(4) {
            return Err(Status::BadAlignment);
        }
        let cut = |start: u32, bytes: &[u8]| {
            let from = (address - start) as usize;
            bytes.get(from..from + count).map(<[u8]>::to_vec).ok_or(Status::InvalidAddress)
        };
        if address < registers::SIZE {
            return cut(0, self.bootstrap.bytes());
        }
        if address >= DESCRIPTION {
            return cut(DESCRIPTION, &self.description);
        }
        if address >= KNOBS {
            let bytes: Vec<u8> = self.settings.knobs.iter().flat_map(|value| value.to_be_bytes()).collect();
            return cut(KNOBS, &bytes);
        }
        if address >= FIRST {
            let value = |feature: &Feature| self.settings.get(feature.id, self.temperature_c).bytes();
            let bytes: Vec<u8> = self.features.iter().flat_map(value).collect();
            return cut(FIRST, &bytes);
        }
        Err(Status::InvalidAddress)
    }

    fn write(
        &mut self,
        address: u32,
        bytes: &[u8],
        from: SocketAddr,
        now: Instant,
        action: &mut Option<Action>,
    ) -> Result<(), Status> {
        if !address.is_multiple_of(4) {
            return Err(Status::BadAlignment);
        }
        if address == registers::PRIVILEGE {
            let word: [u8; 4] = bytes.try_into().map_err(|_| Status::BadAlignment)?;
            return self.take_control(u32::from_be_bytes(word), from, now);
        }
        if self.controller() != Some(from) {
            return Err(Status::AccessDenied);
        }
        if address < registers::SIZE {
            return self.write_bootstrap(address, bytes, now, action);
        }
        let place = |start: u32| {
            let beyond = address - start;
            if beyond.is_multiple_of(STRIDE) {
                Ok((beyond / STRIDE) as usize)
            } else {
                Err(Status::BadAlignment)
            }
        };
        if (KNOBS..DESCRIPTION).contains(&address) {
            let place = place(KNOBS)?;
            let knob = self.info.knobs.get(place).ok_or(Status::InvalidAddress)?;
            let value = f64::from_be_bytes(bytes.try_into().map_err(|_| Status::BadAlignment)?);
            if !(knob.range[0]..=knob.range[1]).contains(&value) {
                return Err(Status::InvalidParameter);
            }
            self.settings.knobs[place] = value;
            return Ok(());
        }
        if (FIRST..KNOBS).contains(&address) {
            let feature = *self.features.get(place(FIRST)?).ok_or(Status::InvalidAddress)?;
            return self.write_feature(&feature, bytes);
        }
        Err(if address >= DESCRIPTION { Status::WriteProtect } else { Status::InvalidAddress })
    }

    fn write_feature(&mut self, feature: &Feature, bytes: &[u8]) -> Result<(), Status> {
        match feature.access {
            Access::Read => return Err(Status::WriteProtect),
            Access::WriteAtRest if self.acquisition.is_some() => return Err(Status::AccessDenied),
            Access::Write | Access::WriteAtRest => {}
        }
        let value = match (feature.kind, bytes.len()) {
            (Kind::Float { .. }, 8) => {
                Value::Float(f64::from_be_bytes(bytes.try_into().map_err(|_| Status::BadAlignment)?))
            }
            (Kind::Integer { .. } | Kind::Choice(_) | Kind::Switch | Kind::Command, 4) => {
                Value::Integer(u32::from_be_bytes(bytes.try_into().map_err(|_| Status::BadAlignment)?))
            }
            _ => return Err(Status::BadAlignment),
        };
        match feature.id {
            Id::AcquisitionStart => {
                if self.acquisition.is_none() {
                    self.acquisitions += 1;
                    self.triggers = 0;
                    self.acquisition = Some(Acquisition {
                        number: self.acquisitions,
                        left: self.settings.frames_of_acquisition(),
                    });
                }
            }
            Id::AcquisitionStop => self.stop(),
            Id::TriggerSoftware => {
                if self.acquisition.is_none() || !self.settings.triggered {
                    return Err(Status::AccessDenied);
                }
                if self.triggers > MOST_TRIGGERS {
                    self.settings.triggers_missed += 1;
                } else {
                    self.triggers += 1;
                }
            }
            _ => self.settings.set(feature, value)?,
        }
        Ok(())
    }

    fn take_control(&mut self, wanted: u32, from: SocketAddr, now: Instant) -> Result<(), Status> {
        if self.controller().is_some_and(|address| address != from) {
            return Err(Status::AccessDenied);
        }
        if wanted & (EXCLUSIVE | CONTROL) == 0 {
            if self.controller.is_some() {
                self.release();
            }
            return Ok(());
        }
        let IpAddr::V4(address) = from.ip() else { return Err(Status::AccessDenied) };
        let exclusive = wanted & EXCLUSIVE != 0;
        self.controller = Some(Controller { address: from, exclusive, heard: now });
        self.bootstrap.set_controller(wanted & (EXCLUSIVE | CONTROL), address, from.port());
        Ok(())
    }

    fn write_bootstrap(
        &mut self,
        address: u32,
        bytes: &[u8],
        now: Instant,
        action: &mut Option<Action>,
    ) -> Result<(), Status> {
        if address == registers::USER_NAME && bytes.len() == registers::USER_NAME_BYTES {
            self.bootstrap.set_user_name(bytes);
            return Ok(());
        }
        let word = u32::from_be_bytes(bytes.try_into().map_err(|_| Status::BadAlignment)?);
        match address {
            registers::HEARTBEAT_TIMEOUT_MS => self.bootstrap.set_heartbeat_ms(word),
            registers::TIMESTAMP_CONTROL => self.bootstrap.set_time(self.ticks(now)),
            registers::STREAM_PORT => self.bootstrap.set(address, word & 0xffff),
            registers::STREAM_DELAY | registers::STREAM_ADDRESS => self.bootstrap.set(address, word),
            registers::STREAM_PACKET => {
                self.bootstrap.set_packet(word);
                if word & registers::FIRE_TEST_PACKET != 0 {
                    *action = Some(Action::TestPacket);
                }
            }
            _ => return Err(Status::WriteProtect),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
