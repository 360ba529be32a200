//! Clients at the registers.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};

use super::*;
use crate::features::test_info;
use crate::pixels::PixelFormat;

const CLIENT: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 40_000);
const OTHER: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 40_001);

struct Client {
    control: Control,
    now: Instant,
    id: u16,
}

impl Client {
    fn new() -> Self {
        let now = Instant::now();
        Self { control: Control::new(&test_info(), Ipv4Addr::LOCALHOST, 5000, now), now, id: 0 }
    }

    fn packet(&mut self, code: u16, payload: &[u8]) -> Vec<u8> {
        self.id = self.id % 60_000 + 1;
        let mut packet = vec![0x42, 1];
        for half in [code, payload.len() as u16, self.id] {
            packet.extend(half.to_be_bytes());
        }
        packet.extend(payload);
        packet
    }

    /// Status and payload of the answer.
    fn ask(&mut self, from: SocketAddr, code: u16, payload: &[u8]) -> (u16, Vec<u8>) {
        let packet = self.packet(code, payload);
        let answer = self.control.handle(&packet, from, false, self.now).answer.unwrap();
        assert_eq!(answer[2..4], (code | 1).to_be_bytes());
        (u16::from_be_bytes([answer[0], answer[1]]), answer[8..].to_vec())
    }

    fn write(&mut self, from: SocketAddr, address: u32, word: u32) -> u16 {
        self.ask(from, 0x82, &[address.to_be_bytes(), word.to_be_bytes()].concat()).0
    }

    fn write_float(&mut self, from: SocketAddr, address: u32, value: f64) -> u16 {
        self.ask(from, 0x86, &[&address.to_be_bytes()[..], &value.to_be_bytes()].concat()).0
    }

    fn read(&mut self, from: SocketAddr, address: u32) -> (u16, u32) {
        let (status, bytes) = self.ask(from, 0x80, &address.to_be_bytes());
        (status, bytes.iter().fold(0, |word, &byte| word << 8 | u32::from(byte)))
    }
}

fn register(id: Id) -> u32 {
    FIRST + STRIDE * id as u32
}

#[test]
fn one_client_controls_and_the_others_only_read() {
    let mut client = Client::new();
    assert_eq!(client.write(CLIENT, register(Id::Width), 32), Status::AccessDenied as u16);
    assert_eq!(client.write(CLIENT, registers::PRIVILEGE, CONTROL), 0);
    assert_eq!(client.write(OTHER, registers::PRIVILEGE, CONTROL), Status::AccessDenied as u16);
    assert_eq!(client.write(CLIENT, register(Id::Width), 32), 0);
    assert_eq!(client.write(OTHER, register(Id::Width), 48), Status::AccessDenied as u16);
    assert_eq!(client.read(OTHER, register(Id::Width)), (0, 32));
    assert_eq!(client.write(CLIENT, registers::PRIVILEGE, EXCLUSIVE), 0);
    assert_eq!(client.read(OTHER, register(Id::Width)).0, Status::AccessDenied as u16);
    assert_eq!(client.read(OTHER, registers::PRIVILEGE), (0, EXCLUSIVE));
    assert_eq!(client.write(CLIENT, registers::PRIVILEGE, 0), 0);
    assert_eq!(client.write(OTHER, registers::PRIVILEGE, CONTROL), 0);
}

#[test]
fn a_silent_controller_is_let_go_and_its_images_end() {
    let mut client = Client::new();
    client.write(CLIENT, registers::PRIVILEGE, CONTROL);
    client.write(CLIENT, registers::STREAM_PORT, 6000);
    client.write(CLIENT, registers::STREAM_ADDRESS, 0x7f00_0001);
    client.write(CLIENT, register(Id::AcquisitionStart), 1);
    assert!(client.control.acquisition.is_some() && client.control.destination().is_some());
    client.now += Duration::from_millis(2900);
    assert_eq!(client.read(CLIENT, registers::PRIVILEGE), (0, CONTROL));
    client.now += Duration::from_millis(2900);
    assert_eq!(client.read(OTHER, registers::PRIVILEGE), (0, CONTROL));
    client.now += Duration::from_millis(200);
    assert_eq!(client.read(OTHER, registers::PRIVILEGE), (0, 0));
    assert!(client.control.acquisition.is_none() && client.control.destination().is_none());
}

#[test]
fn features_are_set_within_their_limits_and_not_under_way() {
    let mut client = Client::new();
    client.write(CLIENT, registers::PRIVILEGE, CONTROL);
    assert_eq!(client.write_float(CLIENT, register(Id::ExposureTime), 2500.0), 0);
    assert_eq!(client.control.settings.exposure_us, 2500.0);
    assert_eq!(client.write_float(CLIENT, register(Id::ExposureTime), 1e9), Status::InvalidParameter as u16);
    assert_eq!(client.write(CLIENT, register(Id::ExposureTime), 7), Status::BadAlignment as u16);
    assert_eq!(client.write(CLIENT, register(Id::PixelFormat), PixelFormat::Mono8.code()), 0);
    assert_eq!(client.read(CLIENT, register(Id::PayloadSize)), (0, 64 * 48));
    assert_eq!(client.write_float(CLIENT, KNOBS, -0.5), 0);
    assert_eq!(client.control.settings.knobs, [-0.5]);
    assert_eq!(client.write_float(CLIENT, KNOBS, 1.5), Status::InvalidParameter as u16);
    assert_eq!(client.write(CLIENT, register(Id::SensorWidth), 7), Status::WriteProtect as u16);
    client.write(CLIENT, register(Id::AcquisitionStart), 1);
    assert_eq!(client.write(CLIENT, register(Id::Width), 32), Status::AccessDenied as u16);
    assert_eq!(client.write_float(CLIENT, register(Id::ExposureTime), 3000.0), 0);
    client.write(CLIENT, register(Id::AcquisitionStop), 1);
    assert_eq!(client.write(CLIENT, register(Id::Width), 32), 0);
}

#[test]
fn a_request_that_is_sent_again_is_carried_out_once() {
    let mut client = Client::new();
    client.write(CLIENT, registers::PRIVILEGE, CONTROL);
    client.write(CLIENT, register(Id::TriggerMode), 1);
    client.write(CLIENT, register(Id::AcquisitionStart), 1);
    let address = register(Id::TriggerSoftware).to_be_bytes();
    let packet = client.packet(0x82, &[address, 1u32.to_be_bytes()].concat());
    let first = client.control.handle(&packet, CLIENT, false, client.now);
    let second = client.control.handle(&packet, CLIENT, false, client.now);
    assert_eq!(first.answer, second.answer);
    assert_eq!(client.control.triggers, 1);
    for _ in 0..3 {
        client.write(CLIENT, register(Id::TriggerSoftware), 1);
    }
    assert_eq!((client.control.triggers, client.read(CLIENT, register(Id::TriggersMissed)).1), (2, 2));
}

#[test]
fn the_description_is_where_the_first_address_says() {
    let mut client = Client::new();
    let (_, url) = client.ask(CLIENT, 0x84, &[0, 0, 2, 0, 0, 0, 2, 0]);
    let url = String::from_utf8(url[4..].to_vec()).unwrap();
    let mut parts = url.trim_end_matches('\0').split(';');
    assert_eq!(parts.next(), Some("Local:retina.xml"));
    let [address, size] = [0, 1].map(|_| u32::from_str_radix(parts.next().unwrap(), 16).unwrap());
    let mut text = Vec::new();
    while (text.len() as u32) < size {
        let at = (address + text.len() as u32).to_be_bytes();
        let (status, bytes) = client.ask(CLIENT, 0x84, &[&at[..], &[0, 0, 2, 0]].concat());
        assert_eq!(status, 0);
        text.extend(&bytes[4..]);
    }
    text.truncate(size as usize);
    let text = String::from_utf8(text).unwrap();
    assert!(text.starts_with("<?xml") && text.ends_with("</RegisterDescription>\n"));
}

/// 100 000 packets, whole, torn and senseless, of one who does not control the device: nothing changes, and every
/// answer is one that the standard knows.
#[test]
fn senseless_packets_change_nothing() {
    let mut client = Client::new();
    client.write(CLIENT, registers::PRIVILEGE, CONTROL);
    let (settings, bootstrap) = (client.control.settings.clone(), client.control.bootstrap.clone());
    let mut random = ChaCha8Rng::seed_from_u64(22);
    let codes = [0x02, 0x04, 0x40, 0x80, 0x82, 0x84, 0x86, 0x100];
    for round in 0..100_000 {
        let size = random.next_u32() as usize % 64;
        let mut packet: Vec<u8> = (0..size).map(|_| random.next_u32() as u8).collect();
        if round % 4 != 0 && size >= 8 {
            packet[0] = 0x42;
            packet[1] |= 1;
            let code: u16 = codes[random.next_u32() as usize % codes.len()];
            packet[2..4].copy_from_slice(&code.to_be_bytes());
            if round % 4 != 1 {
                packet[4..6].copy_from_slice(&(size as u16 - 8).to_be_bytes());
            }
            // Addresses that exist.
            if round % 4 == 3 && size >= 12 {
                let address =
                    [registers::PRIVILEGE, register(Id::Width), KNOBS, DESCRIPTION, registers::STREAM_PORT];
                let address = address[random.next_u32() as usize % address.len()];
                packet[8..12].copy_from_slice(&address.to_be_bytes());
            }
        }
        let outcome = client.control.handle(&packet, OTHER, round % 7 == 0, client.now);
        assert!(outcome.answer.is_none_or(|answer| answer.len() >= 8 && answer.len() <= 548));
        assert!(!matches!(outcome.action, Some(Action::TestPacket)));
    }
    assert_eq!((client.control.settings, client.control.bootstrap), (settings, bootstrap));
}
