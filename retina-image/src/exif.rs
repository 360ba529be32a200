//! What a camera wrote beside a picture.

use std::io::Cursor;

use exif::{In, Reader, Tag, Value};

/// Diagonal of the 35-mm format, mm: equivalent focal lengths are those of the same diagonal field (CIPA DCG-001).
const FULL_FRAME_DIAGONAL_MM: f64 = 43.2666;

/// EXIF data, as far as they matter here; what a file does not have is absent.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Exif {
    /// Exposure time, s.
    pub exposure_s: Option<f64>,
    /// Focal length, mm.
    pub focal_mm: Option<f64>,
    /// Focal length at which the 35-mm format has the same diagonal field, mm.
    pub focal_35mm_mm: Option<f64>,
    /// Date and time of the exposure by the camera's clock, `2023-12-22T19:21:25`.
    pub local_time: Option<String>,
    /// The clock's offset from UTC, `+01:00`.
    pub utc_offset: Option<String>,
    /// How viewers turn the picture, 1 (not at all) to 8.
    pub orientation: Option<u8>,
}

impl Exif {
    /// From the bytes of a JPEG, PNG or TIFF; damaged data are none.
    pub(crate) fn of(bytes: &[u8]) -> Self {
        let Ok(read) = Reader::new().read_from_container(&mut Cursor::new(bytes)) else {
            return Self::default();
        };
        let field = |tag: Tag| read.get_field(tag, In::PRIMARY).map(|field| &field.value);
        let whole = |tag| field(tag).and_then(|value| value.get_uint(0));
        let positive = |tag| {
            let value = match field(tag)? {
                Value::Rational(values) => values.first()?.to_f64(),
                value => f64::from(value.get_uint(0)?),
            };
            (value.is_finite() && value > 0.0).then_some(value)
        };
        let text = |tag| match field(tag)? {
            Value::Ascii(lines) => String::from_utf8(lines.first()?.clone()).ok(),
            _ => None,
        };
        let utc_offset = text(Tag::OffsetTimeOriginal).map(|text| text.trim().to_owned());
        Self {
            exposure_s: positive(Tag::ExposureTime),
            focal_mm: positive(Tag::FocalLength),
            focal_35mm_mm: positive(Tag::FocalLengthIn35mmFilm),
            local_time: text(Tag::DateTimeOriginal).and_then(|text| iso_time(&text)),
            utc_offset: utc_offset.filter(|text| is_offset(text)),
            orientation: whole(Tag::Orientation)
                .and_then(|value| u8::try_from(value).ok())
                .filter(|value| (1..=8).contains(value)),
        }
    }

    /// Focal length in pixels of a picture of this size that was not cropped, by the 35-mm equivalent.
    pub fn focal_px(&self, size_px: [u32; 2]) -> Option<f64> {
        let [width, height] = size_px.map(f64::from);
        self.focal_35mm_mm.map(|focal_mm| focal_mm / FULL_FRAME_DIAGONAL_MM * width.hypot(height))
    }

    pub(crate) fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let lengths = [
            self.exposure_s.map(|s| format!("exposure {s:.6} s")),
            self.focal_mm.map(|mm| format!("focal length {mm} mm")),
            self.focal_35mm_mm.map(|mm| format!("{mm} mm in the 35-mm format")),
        ];
        let said: Vec<String> = lengths.into_iter().flatten().collect();
        if !said.is_empty() {
            notes.push(format!("EXIF: {}", said.join(", ")));
        }
        match (&self.local_time, &self.utc_offset) {
            (Some(time), Some(offset)) => {
                notes.push(format!("EXIF time: {time}{offset}, which is not used by itself"))
            }
            (Some(time), None) => notes.push(format!(
                "EXIF time: {time} by the camera's clock, without its offset from UTC; it is not used"
            )),
            (None, _) => {}
        }
        notes
    }
}

/// `2023:12:22 19:21:25` of EXIF as `2023-12-22T19:21:25`; a clock that was never set is none.
fn iso_time(text: &str) -> Option<String> {
    let (date, time) = text.trim().split_once(' ')?;
    let numbers = |text: &str| -> Option<Vec<u32>> {
        text.split(':')
            .map(|part| part.parse().ok().filter(|_| part.bytes().all(|b| b.is_ascii_digit())))
            .collect()
    };
    match (&numbers(date)?[..], &numbers(time)?[..]) {
        (&[y @ 1900..=2100, m @ 1..=12, d @ 1..=31], &[h @ 0..=23, min @ 0..=59, s @ 0..=60]) => {
            Some(format!("{y:04}-{m:02}-{d:02}T{h:02}:{min:02}:{s:02}"))
        }
        _ => None,
    }
}

/// Whether this is `+hh:mm` or `-hh:mm`.
fn is_offset(text: &str) -> bool {
    let Some((hours, minutes)) = text.strip_prefix(['+', '-']).and_then(|rest| rest.split_once(':')) else {
        return false;
    };
    let below = |text: &str, end: u32| text.len() == 2 && text.parse::<u32>().is_ok_and(|value| value < end);
    below(hours, 24) && below(minutes, 60)
}
