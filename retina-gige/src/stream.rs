//! The image stream (GVSP): an image as a leader, its bytes in packets, and a trailer.

use crate::packet::HEADER;
use crate::pixels::PixelFormat;

/// Headers of IP, UDP and the stream itself, which the size of a packet counts.
const HEADERS: usize = 20 + 8 + HEADER;
const LEADER: u8 = 1;
const TRAILER: u8 = 2;
const PAYLOAD: u8 = 3;
const IMAGE: u16 = 1;

/// An image that is sent, and kept for a while in case packets get lost.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Block {
    /// Its number, 1 to 65535.
    pub(crate) id: u16,
    pub(crate) timestamp_ticks: u64,
    pub(crate) format: PixelFormat,
    pub(crate) size_px: [u32; 2],
    pub(crate) offset_px: [u32; 2],
    pub(crate) bytes: Vec<u8>,
    /// Bytes of a packet with its headers.
    pub(crate) packet_bytes: usize,
}

impl Block {
    fn chunk(&self) -> usize {
        self.packet_bytes - HEADERS
    }

    /// Packets of the image, with leader and trailer.
    pub(crate) fn packets(&self) -> u32 {
        self.bytes.len().div_ceil(self.chunk()) as u32 + 2
    }

    /// A packet of it; `None` beyond the last.
    pub(crate) fn packet(&self, number: u32) -> Option<Vec<u8>> {
        let last = self.packets() - 1;
        let mut packet = Vec::with_capacity(self.packet_bytes);
        let kind = match number {
            0 => LEADER,
            _ if number < last => PAYLOAD,
            _ if number == last => TRAILER,
            _ => return None,
        };
        head(&mut packet, 0, self.id, kind, number);
        match kind {
            LEADER => {
                for half in [0, IMAGE] {
                    packet.extend(half.to_be_bytes());
                }
                packet.extend(self.timestamp_ticks.to_be_bytes());
                let [width, height] = self.size_px;
                for word in [self.format.code(), width, height, self.offset_px[0], self.offset_px[1], 0] {
                    packet.extend(word.to_be_bytes());
                }
            }
            TRAILER => {
                for half in [0, IMAGE] {
                    packet.extend(half.to_be_bytes());
                }
                packet.extend(self.size_px[1].to_be_bytes());
            }
            _ => {
                let from = (number as usize - 1) * self.chunk();
                packet.extend(&self.bytes[from..self.bytes.len().min(from + self.chunk())]);
            }
        }
        Some(packet)
    }
}

/// A packet's header.
fn head(packet: &mut Vec<u8>, status: u16, block: u16, kind: u8, number: u32) {
    packet.extend(status.to_be_bytes());
    packet.extend(block.to_be_bytes());
    packet.extend((u32::from(kind) << 24 | number & 0xff_ffff).to_be_bytes());
}

/// The answer to a request for a packet that is not kept any more.
pub(crate) fn unavailable(block: u16, number: u32) -> Vec<u8> {
    let mut packet = Vec::new();
    head(&mut packet, 0x800c, block, PAYLOAD, number);
    packet
}

/// A packet that shows the client whether packets of this size arrive.
pub(crate) fn test_packet(packet_bytes: usize) -> Vec<u8> {
    (0..packet_bytes - 28).map(|place| place as u8).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_is_cut_into_packets_and_put_together_again() {
        let bytes: Vec<u8> = (0..5000).map(|i| (i * 7) as u8).collect();
        let block = Block {
            id: 9,
            timestamp_ticks: 0x0102_0304_0506_0708,
            format: PixelFormat::Mono8,
            size_px: [100, 50],
            offset_px: [1, 2],
            bytes: bytes.clone(),
            packet_bytes: 1500,
        };
        assert_eq!(block.packets(), 6);
        let leader = block.packet(0).unwrap();
        assert_eq!(leader[..8], [0, 0, 0, 9, 1, 0, 0, 0]);
        assert_eq!(leader[8..20], [0, 0, 0, 1, 1, 2, 3, 4, 5, 6, 7, 8]);
        assert_eq!(leader[20..32], [1, 8, 0, 1, 0, 0, 0, 100, 0, 0, 0, 50]);
        assert_eq!(leader.len(), 44);
        let joined: Vec<u8> = (1..5).flat_map(|k| block.packet(k).unwrap().split_off(8)).collect();
        assert_eq!(joined, bytes);
        assert_eq!(block.packet(1).unwrap().len(), 1500 - 28);
        assert_eq!(block.packet(5).unwrap(), [0, 0, 0, 9, 2, 0, 0, 5, 0, 0, 0, 1, 0, 0, 0, 50]);
        assert_eq!(block.packet(6), None);
    }
}
