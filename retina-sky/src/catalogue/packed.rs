//! The embedded catalogue's bytes; `validation/build_catalogue.py` writes them and gives the layout.

use super::{Star, StarId, StarNotes};

const MAGIC: &[u8; 8] = b"RETSTARS";
const VERSION: u32 = 1;
const HEADER_BYTES: usize = 32;
const RECORD_BYTES: usize = 25;
/// B-V of a star without one, millimagnitudes.
const NO_COLOUR: i16 = i16::MIN;
/// Angles of the records, radians.
const ANGLE_RAD: f64 = std::f64::consts::TAU / 4_294_967_296.0;

/// The stars; `None` where the bytes are not such a catalogue.
pub(super) fn read(bytes: &[u8]) -> Option<Vec<Star>> {
    let (header, records) = bytes.split_at_checked(HEADER_BYTES)?;
    let word = |at: usize| Some(u32::from_le_bytes(header.get(at..at + 4)?.try_into().ok()?));
    let epoch_jyear = f64::from_le_bytes(header.get(24..32)?.try_into().ok()?);
    let count = word(16)? as usize;
    let whole = header.starts_with(MAGIC)
        && word(8)? == VERSION
        && word(12)? as usize == RECORD_BYTES
        && records.len() == count * RECORD_BYTES;
    if !whole {
        return None;
    }
    records.as_chunks::<RECORD_BYTES>().0.iter().map(|record| star(record, epoch_jyear)).collect()
}

fn star(record: &[u8; RECORD_BYTES], epoch_jyear: f64) -> Option<Star> {
    let word = |at: usize| Some(u32::from_le_bytes(record.get(at..at + 4)?.try_into().ok()?));
    let short = |at: usize| Some(i16::from_le_bytes(record.get(at..at + 2)?.try_into().ok()?));
    // Three bytes in the upper part of four, so that the shift back carries the sign.
    let hundredths = |at: usize| {
        let &[low, middle, high] = record.get(at..at + 3)? else { return None };
        Some(f64::from(i32::from_le_bytes([0, low, middle, high]) >> 8) / 100.0)
    };
    let flags = record[3];
    let ra_rad = f64::from(word(4)?) * ANGLE_RAD;
    let dec_rad = f64::from(word(8)?.cast_signed()) * ANGLE_RAD;
    let id = StarId::Hipparcos(word(0)? & 0xff_ffff);
    let motion = [hundredths(12)?, hundredths(15)?, hundredths(18)?];
    let colour = short(23)?;
    Some(Star {
        v_magnitude: f64::from(short(21)?) / 1000.0,
        b_v: (colour != NO_COLOUR).then(|| f64::from(colour) / 1000.0),
        notes: StarNotes {
            not_in_i311: flags & 1 != 0,
            no_proper_motion: flags & 2 != 0,
            no_parallax: flags & 4 != 0,
            several_components: flags & 8 != 0,
            doubtful: flags & 16 != 0,
        },
        ..Star::new(id, epoch_jyear, [ra_rad, dec_rad], motion)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_that_are_no_catalogue_are_refused() {
        let whole = retina_assets::HIPPARCOS;
        assert!(read(whole).is_some());
        assert!(read(&whole[..whole.len() - 1]).is_none() && read(&whole[..20]).is_none());
        for at in [0, 8, 12, 16] {
            let mut broken = whole.to_vec();
            broken[at] ^= 1;
            assert!(read(&broken).is_none(), "byte {at}");
        }
    }
}
