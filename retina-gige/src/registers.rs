//! The bootstrap registers: what every GigE Vision device has at the same addresses.

use std::net::Ipv4Addr;

use crate::imager::CameraInfo;

/// Bytes that they take.
pub(crate) const SIZE: u32 = 0x1000;
/// Bytes of an answer to a discovery: the first registers.
pub(crate) const DISCOVERY: usize = 0xf8;

pub(crate) const USER_NAME: u32 = 0x00e8;
pub(crate) const USER_NAME_BYTES: usize = 16;
pub(crate) const HEARTBEAT_TIMEOUT_MS: u32 = 0x0938;
pub(crate) const TIMESTAMP_CONTROL: u32 = 0x0944;
pub(crate) const TIMESTAMP_HIGH: u32 = 0x0948;
pub(crate) const TIMESTAMP_LOW: u32 = 0x094c;
pub(crate) const PRIVILEGE: u32 = 0x0a00;
const PRIMARY_PORT: u32 = 0x0a04;
const PRIMARY_ADDRESS: u32 = 0x0a14;
pub(crate) const STREAM_PORT: u32 = 0x0d00;
pub(crate) const STREAM_PACKET: u32 = 0x0d04;
pub(crate) const STREAM_DELAY: u32 = 0x0d08;
pub(crate) const STREAM_ADDRESS: u32 = 0x0d18;
const STREAM_SOURCE: u32 = 0x0d1c;

/// Nanoseconds: ticks of the time stamps in a second.
pub(crate) const TICKS_PER_S: u64 = 1_000_000_000;
/// Bit of [`STREAM_PACKET`] that asks for a test packet.
pub(crate) const FIRE_TEST_PACKET: u32 = 0x8000_0000;
const DO_NOT_FRAGMENT: u32 = 0x4000_0000;
/// Sizes of stream packets, with the headers of IP (20), UDP (8) and the stream (8).
pub(crate) const PACKET_BYTES: std::ops::RangeInclusive<u32> = 576..=16_000;
/// Times without a word from the controller after which it is gone, ms.
const HEARTBEATS_MS: std::ops::RangeInclusive<u32> = 500..=600_000;

/// The registers' bytes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Bootstrap {
    bytes: Vec<u8>,
}

impl Bootstrap {
    pub(crate) fn new(info: &CameraInfo, address: Ipv4Addr, stream_port: u16, url: &str) -> Self {
        let mut new = Self { bytes: vec![0; SIZE as usize] };
        let octets = address.octets();
        // A locally administered hardware address, made of the network address.
        let mac = u64::from_be_bytes([0, 0, 0x02, 0x52, octets[0], octets[1], octets[2], octets[3]]);
        for (at, word) in [
            (0x0000, 1 << 16 | 2), // version 1.2
            (0x0004, 0x8000_0001), // big-endian, UTF-8
            (0x0008, (mac >> 32) as u32),
            (0x000c, mac as u32),
            (0x0010, 0x4), // addresses: by the machine, as link-local ones are
            (0x0014, 0x4),
            (0x0024, u32::from(address)),
            (0x0034, if address.is_loopback() { 0xff00_0000 } else { 0xffff_ff00 }),
            (0x0600, 1),           // network interfaces
            (0x0900, 0),           // message channels
            (0x0904, 1),           // stream channels
            (0x0934, 0xc000_0007), // user name, serial number; resend, memory writes, several registers
            (HEARTBEAT_TIMEOUT_MS, 3000),
            (0x093c, (TICKS_PER_S >> 32) as u32),
            (0x0940, TICKS_PER_S as u32),
            (STREAM_PACKET, 1500),
            (STREAM_SOURCE, stream_port.into()),
        ] {
            new.set(at, word);
        }
        new.set_text(0x0048, 32, "RETINA");
        new.set_text(0x0068, 32, &info.model);
        new.set_text(0x0088, 32, env!("CARGO_PKG_VERSION"));
        new.set_text(0x00a8, 48, "virtual bench");
        new.set_text(0x00d8, 16, &info.serial);
        new.set_text(0x0200, 512, url);
        new
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// A register; 0 beyond them.
    pub(crate) fn get(&self, at: u32) -> u32 {
        let bytes = self.bytes.get(at as usize..at as usize + 4);
        bytes.map_or(0, |bytes| bytes.iter().fold(0, |word, &byte| word << 8 | u32::from(byte)))
    }

    pub(crate) fn set(&mut self, at: u32, word: u32) {
        self.bytes[at as usize..at as usize + 4].copy_from_slice(&word.to_be_bytes());
    }

    pub(crate) fn set_text(&mut self, at: u32, size: usize, text: &str) {
        let field = &mut self.bytes[at as usize..at as usize + size];
        field.fill(0);
        // The last byte stays 0.
        let kept = text.len().min(size - 1);
        field[..kept].copy_from_slice(&text.as_bytes()[..kept]);
    }

    /// The client's name for the device.
    pub(crate) fn set_user_name(&mut self, bytes: &[u8]) {
        self.bytes[USER_NAME as usize..][..USER_NAME_BYTES].copy_from_slice(bytes);
    }

    pub(crate) fn set_time(&mut self, ticks: u64) {
        self.set(TIMESTAMP_HIGH, (ticks >> 32) as u32);
        self.set(TIMESTAMP_LOW, ticks as u32);
    }

    pub(crate) fn set_controller(&mut self, privilege: u32, address: Ipv4Addr, port: u16) {
        self.set(PRIVILEGE, privilege);
        self.set(PRIMARY_PORT, port.into());
        self.set(PRIMARY_ADDRESS, address.into());
    }

    pub(crate) fn heartbeat_ms(&self) -> u32 {
        self.get(HEARTBEAT_TIMEOUT_MS)
    }

    pub(crate) fn set_heartbeat_ms(&mut self, wanted: u32) {
        self.set(HEARTBEAT_TIMEOUT_MS, wanted.clamp(*HEARTBEATS_MS.start(), *HEARTBEATS_MS.end()));
    }

    /// Bytes of a stream packet with all its headers.
    pub(crate) fn packet_bytes(&self) -> u32 {
        self.get(STREAM_PACKET) & 0xffff
    }

    pub(crate) fn set_packet(&mut self, wanted: u32) {
        let bytes = (wanted & 0xffff).clamp(*PACKET_BYTES.start(), *PACKET_BYTES.end()) & !3;
        self.set(STREAM_PACKET, wanted & DO_NOT_FRAGMENT | bytes);
    }
}
