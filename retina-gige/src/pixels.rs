//! Formats of pixels on the wire.

/// A pixel format, with the number that the Pixel Format Naming Convention gives it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum PixelFormat {
    /// 8 bits.
    Mono8 = 0x0108_0001,
    /// 10 bits in 16, little-endian.
    Mono10 = 0x0110_0003,
    /// 10 bits without gaps, lowest bits first.
    Mono10p = 0x010a_0046,
    /// 12 bits in 16, little-endian.
    Mono12 = 0x0110_0005,
    /// 12 bits without gaps, lowest bits first.
    Mono12p = 0x010c_0047,
    /// 12 bits, two pixels in three bytes as GigE Vision packs them: the high bytes outside.
    Mono12Packed = 0x010c_0006,
    /// 16 bits, little-endian.
    Mono16 = 0x0110_0007,
}

impl PixelFormat {
    /// All formats.
    pub const ALL: [Self; 7] = [
        Self::Mono8,
        Self::Mono10,
        Self::Mono10p,
        Self::Mono12,
        Self::Mono12p,
        Self::Mono12Packed,
        Self::Mono16,
    ];

    /// The format of a number.
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.code() == code)
    }

    /// Its number.
    pub fn code(self) -> u32 {
        self as u32
    }

    /// Its standard name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mono8 => "Mono8",
            Self::Mono10 => "Mono10",
            Self::Mono10p => "Mono10p",
            Self::Mono12 => "Mono12",
            Self::Mono12p => "Mono12p",
            Self::Mono12Packed => "Mono12Packed",
            Self::Mono16 => "Mono16",
        }
    }

    /// Bits of a digital count.
    pub fn bits(self) -> u32 {
        match self {
            Self::Mono8 => 8,
            Self::Mono10 | Self::Mono10p => 10,
            Self::Mono12 | Self::Mono12p | Self::Mono12Packed => 12,
            Self::Mono16 => 16,
        }
    }

    /// Bytes of so many pixels.
    pub fn bytes(self, pixels: usize) -> usize {
        let bits_on_the_wire = (self.code() >> 16 & 0xff) as usize;
        (pixels * bits_on_the_wire).div_ceil(8)
    }

    /// Counts of `sensor_bits` as bytes on the wire: the most significant bits of both fall together.
    pub fn encode(self, counts: &[u16], sensor_bits: u32) -> Vec<u8> {
        let bits = self.bits();
        let scaled = |count: u16| {
            if bits >= sensor_bits { count << (bits - sensor_bits) } else { count >> (sensor_bits - bits) }
        };
        let mut bytes = Vec::with_capacity(self.bytes(counts.len()));
        match self {
            Self::Mono8 => bytes.extend(counts.iter().map(|&count| scaled(count) as u8)),
            Self::Mono10 | Self::Mono12 | Self::Mono16 => {
                bytes.extend(counts.iter().flat_map(|&count| scaled(count).to_le_bytes()));
            }
            Self::Mono12Packed => {
                for pair in counts.chunks(2) {
                    let (a, b) = (scaled(pair[0]), pair.get(1).map(|&count| scaled(count)));
                    bytes.push((a >> 4) as u8);
                    bytes.push((a & 0xf) as u8 | ((b.unwrap_or(0) & 0xf) << 4) as u8);
                    bytes.extend(b.map(|b| (b >> 4) as u8));
                }
            }
            Self::Mono10p | Self::Mono12p => {
                let (mut held, mut held_bits) = (0u32, 0);
                for &count in counts {
                    held |= u32::from(scaled(count)) << held_bits;
                    held_bits += bits;
                    while held_bits >= 8 {
                        bytes.push(held as u8);
                        held >>= 8;
                        held_bits -= 8;
                    }
                }
                if held_bits > 0 {
                    bytes.push(held as u8);
                }
            }
        }
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_packed_as_the_standards_say() {
        let counts = [0xabc, 0x123, 0xfff];
        assert_eq!(PixelFormat::Mono8.encode(&counts, 12), [0xab, 0x12, 0xff]);
        assert_eq!(PixelFormat::Mono12.encode(&counts[..1], 12), [0xbc, 0x0a]);
        assert_eq!(PixelFormat::Mono16.encode(&counts[..1], 12), [0xc0, 0xab]);
        assert_eq!(PixelFormat::Mono12Packed.encode(&counts, 12), [0xab, 0x3c, 0x12, 0xff, 0x0f]);
        assert_eq!(PixelFormat::Mono12p.encode(&counts, 12), [0xbc, 0x3a, 0x12, 0xff, 0x0f]);
        // Four of ten bits are five bytes: 1, 2, 3, 4 from the lowest bit on.
        assert_eq!(PixelFormat::Mono10p.encode(&[1, 2, 3, 4], 10), [0x01, 0x08, 0x30, 0x00, 0x01]);
        for format in PixelFormat::ALL {
            assert_eq!(PixelFormat::from_code(format.code()), Some(format));
            for pixels in [1usize, 2, 3, 7, 64] {
                assert_eq!(format.encode(&vec![5; pixels], 10).len(), format.bytes(pixels), "{format:?}");
            }
        }
    }
}
