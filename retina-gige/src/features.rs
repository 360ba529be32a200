//! The features of the device: one table, from which its registers and its description follow.

use crate::imager::CameraInfo;
use crate::packet::Status;
use crate::pixels::PixelFormat;

/// Address of the first feature's register.
pub(crate) const FIRST: u32 = 0x1_0000;
/// Address of the first knob's register.
pub(crate) const KNOBS: u32 = 0x2_0000;
/// Bytes from one register to the next.
pub(crate) const STRIDE: u32 = 8;

/// Smallest width and height of an image, px.
const SMALLEST_PX: i64 = 16;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Id {
    DeviceTemperature,
    DeviceLinkThroughputLimit,
    SensorWidth,
    SensorHeight,
    WidthMax,
    HeightMax,
    /// Largest width at the present offset, and so on: what the description bounds the features by.
    WidthLimit,
    HeightLimit,
    OffsetXLimit,
    OffsetYLimit,
    Width,
    Height,
    OffsetX,
    OffsetY,
    BinningHorizontal,
    BinningVertical,
    PixelFormat,
    AcquisitionMode,
    AcquisitionStart,
    AcquisitionStop,
    AcquisitionFrameCount,
    AcquisitionFrameRateEnable,
    AcquisitionFrameRate,
    ExposureMode,
    ExposureTime,
    TriggerSelector,
    TriggerMode,
    TriggerSource,
    TriggerSoftware,
    TriggersMissed,
    Gain,
    PayloadSize,
    TLParamsLocked,
}

/// Largest value of an integer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Limit {
    Is(i64),
    Of(Id),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    Integer { min: i64, max: Limit, unit: &'static str },
    Float { min: f64, max: f64, unit: &'static str },
    Choice(&'static [(&'static str, u32)]),
    Switch,
    Command,
}

/// Who may change a feature, and when.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Access {
    Read,
    Write,
    /// Not while images are taken: their size depends on it.
    WriteAtRest,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Feature {
    pub(crate) id: Id,
    pub(crate) category: &'static str,
    pub(crate) kind: Kind,
    pub(crate) access: Access,
    pub(crate) meaning: &'static str,
}

impl Feature {
    /// Its standard name.
    pub(crate) fn name(&self) -> String {
        format!("{:?}", self.id)
    }
}

const OFF_ON: &[(&str, u32)] = &[("Off", 0), ("On", 1)];
const FORMATS: &[(&str, u32)] = &[
    ("Mono8", PixelFormat::Mono8 as u32),
    ("Mono10", PixelFormat::Mono10 as u32),
    ("Mono10p", PixelFormat::Mono10p as u32),
    ("Mono12", PixelFormat::Mono12 as u32),
    ("Mono12p", PixelFormat::Mono12p as u32),
    ("Mono12Packed", PixelFormat::Mono12Packed as u32),
    ("Mono16", PixelFormat::Mono16 as u32),
];
/// Values of `AcquisitionMode`.
const CONTINUOUS: u32 = 0;
const SINGLE_FRAME: u32 = 1;
const MULTI_FRAME: u32 = 2;

/// The device's features, in the order of their registers.
pub(crate) fn table(info: &CameraInfo) -> Vec<Feature> {
    use Access::{Read, Write, WriteAtRest};
    use Kind::{Choice, Command, Float, Integer};
    let px = |min: i64, max: Limit| Integer { min, max, unit: "px" };
    let size = |pixels: u32| Integer { min: 0, max: Limit::Is(i64::from(pixels)), unit: "px" };
    let count = |max: i64| Integer { min: 1, max: Limit::Is(max), unit: "" };
    let us = Float { min: 10.0, max: info.longest_exposure_s * 1e6, unit: "us" };
    let [width, height] = [info.width_px, info.height_px];
    const DEVICE: &str = "DeviceControl";
    const IMAGE: &str = "ImageFormatControl";
    const TAKING: &str = "AcquisitionControl";
    const WIRE: &str = "TransportLayerControl";
    let of = |id, category, kind, access, meaning| Feature { id, category, kind, access, meaning };
    let features = vec![
        of(
            Id::DeviceTemperature,
            DEVICE,
            Float { min: -100.0, max: 200.0, unit: "C" },
            Read,
            "Temperature of the bench",
        ),
        of(
            Id::DeviceLinkThroughputLimit,
            DEVICE,
            Integer { min: 1_000_000, max: Limit::Is(1_250_000_000), unit: "Bps" },
            Write,
            "Bytes sent in a second at most",
        ),
        of(Id::SensorWidth, IMAGE, size(width), Read, "Width of the sensor"),
        of(Id::SensorHeight, IMAGE, size(height), Read, "Height of the sensor"),
        of(Id::WidthMax, IMAGE, size(width), Read, "Width of the sensor after binning"),
        of(Id::HeightMax, IMAGE, size(height), Read, "Height of the sensor after binning"),
        of(Id::WidthLimit, IMAGE, size(width), Read, "Largest width at this offset"),
        of(Id::HeightLimit, IMAGE, size(height), Read, "Largest height at this offset"),
        of(Id::OffsetXLimit, IMAGE, size(width), Read, "Largest offset at this width"),
        of(Id::OffsetYLimit, IMAGE, size(height), Read, "Largest offset at this height"),
        of(Id::Width, IMAGE, px(SMALLEST_PX, Limit::Of(Id::WidthLimit)), WriteAtRest, "Width of the image"),
        of(
            Id::Height,
            IMAGE,
            px(SMALLEST_PX, Limit::Of(Id::HeightLimit)),
            WriteAtRest,
            "Height of the image",
        ),
        of(Id::OffsetX, IMAGE, px(0, Limit::Of(Id::OffsetXLimit)), WriteAtRest, "First column of the image"),
        of(Id::OffsetY, IMAGE, px(0, Limit::Of(Id::OffsetYLimit)), WriteAtRest, "First row of the image"),
        of(Id::BinningHorizontal, IMAGE, count(4), WriteAtRest, "Columns whose light is summed"),
        of(Id::BinningVertical, IMAGE, count(4), WriteAtRest, "Rows whose light is summed"),
        of(Id::PixelFormat, IMAGE, Choice(FORMATS), WriteAtRest, "Digital counts on the wire"),
        of(
            Id::AcquisitionMode,
            TAKING,
            Choice(&[("Continuous", CONTINUOUS), ("SingleFrame", SINGLE_FRAME), ("MultiFrame", MULTI_FRAME)]),
            WriteAtRest,
            "When the acquisition ends by itself",
        ),
        of(Id::AcquisitionStart, TAKING, Command, Write, "Begins to take images"),
        of(Id::AcquisitionStop, TAKING, Command, Write, "Ends taking images"),
        of(Id::AcquisitionFrameCount, TAKING, count(65_535), WriteAtRest, "Images in the mode MultiFrame"),
        of(Id::AcquisitionFrameRateEnable, TAKING, Kind::Switch, Write, "Whether the frame rate is held"),
        of(
            Id::AcquisitionFrameRate,
            TAKING,
            Float { min: 0.01, max: 1000.0, unit: "Hz" },
            Write,
            "Images in a second, at most",
        ),
        of(Id::ExposureMode, TAKING, Choice(&[("Timed", 0)]), Write, "What ends an exposure"),
        of(Id::ExposureTime, TAKING, us, Write, "Exposure time"),
        of(Id::TriggerSelector, TAKING, Choice(&[("FrameStart", 0)]), Write, "What a trigger begins"),
        of(Id::TriggerMode, TAKING, Choice(OFF_ON), Write, "Whether an image waits for a trigger"),
        of(Id::TriggerSource, TAKING, Choice(&[("Software", 0)]), Write, "Where triggers come from"),
        of(Id::TriggerSoftware, TAKING, Command, Write, "A trigger"),
        of(
            Id::TriggersMissed,
            TAKING,
            Integer { min: 0, max: Limit::Is(i64::from(u32::MAX)), unit: "" },
            Read,
            "Triggers that came while two exposures were waiting",
        ),
        of(
            Id::Gain,
            "AnalogControl",
            Float { min: 0.0, max: 24.0, unit: "dB" },
            Write,
            "Gain of the digital counts",
        ),
        of(
            Id::PayloadSize,
            WIRE,
            Integer { min: 0, max: Limit::Is(i64::from(u32::MAX)), unit: "B" },
            Read,
            "Bytes of an image",
        ),
        of(
            Id::TLParamsLocked,
            WIRE,
            Integer { min: 0, max: Limit::Is(1), unit: "" },
            Write,
            "Set by clients while they receive images",
        ),
    ];
    debug_assert!(features.iter().enumerate().all(|(place, feature)| feature.id as usize == place));
    features
}

/// A feature's value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Value {
    Integer(u32),
    Float(f64),
}

impl Value {
    /// Its register's bytes.
    pub(crate) fn bytes(self) -> [u8; STRIDE as usize] {
        match self {
            Self::Float(value) => value.to_be_bytes(),
            Self::Integer(value) => (u64::from(value) << 32).to_be_bytes(),
        }
    }
}

/// What the features say now.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Settings {
    sensor_px: [u32; 2],
    pub(crate) size_px: [u32; 2],
    pub(crate) offset_px: [u32; 2],
    pub(crate) binning: [u32; 2],
    pub(crate) format: PixelFormat,
    mode: u32,
    frame_count: u32,
    hold_rate: bool,
    rate_hz: f64,
    pub(crate) exposure_us: f64,
    pub(crate) triggered: bool,
    pub(crate) triggers_missed: u32,
    pub(crate) gain_db: f64,
    pub(crate) bytes_per_s: u32,
    locked: u32,
    /// Values of the imager's knobs.
    pub(crate) knobs: Vec<f64>,
}

impl Settings {
    pub(crate) fn new(info: &CameraInfo) -> Self {
        let sensor_px = [info.width_px, info.height_px];
        Self {
            sensor_px,
            size_px: sensor_px,
            offset_px: [0; 2],
            binning: [1; 2],
            format: if info.bits > 8 { PixelFormat::Mono12 } else { PixelFormat::Mono8 },
            mode: CONTINUOUS,
            frame_count: 1,
            hold_rate: true,
            rate_hz: 10.0,
            exposure_us: 10_000f64.min(info.longest_exposure_s * 1e6),
            triggered: false,
            triggers_missed: 0,
            gain_db: 0.0,
            bytes_per_s: 125_000_000,
            locked: 0,
            knobs: info.knobs.iter().map(|knob| knob.value).collect(),
        }
    }

    fn max_px(&self, axis: usize) -> u32 {
        self.sensor_px[axis] / self.binning[axis]
    }

    /// Bytes of an image.
    pub(crate) fn payload_bytes(&self) -> usize {
        self.format.bytes(self.size_px[0] as usize * self.size_px[1] as usize)
    }

    /// Images of an acquisition; `None` where it does not end by itself.
    pub(crate) fn frames_of_acquisition(&self) -> Option<u32> {
        match self.mode {
            SINGLE_FRAME => Some(1),
            MULTI_FRAME => Some(self.frame_count),
            _ => None,
        }
    }

    /// Time between the starts of two images, s; 0 where the rate is free.
    pub(crate) fn period_s(&self) -> f64 {
        if self.hold_rate { 1.0 / self.rate_hz } else { 0.0 }
    }

    pub(crate) fn get(&self, id: Id, temperature_c: f64) -> Value {
        use Value::{Float, Integer};
        match id {
            Id::DeviceTemperature => Float(temperature_c),
            Id::DeviceLinkThroughputLimit => Integer(self.bytes_per_s),
            Id::SensorWidth => Integer(self.sensor_px[0]),
            Id::SensorHeight => Integer(self.sensor_px[1]),
            Id::WidthMax => Integer(self.max_px(0)),
            Id::HeightMax => Integer(self.max_px(1)),
            Id::WidthLimit => Integer(self.max_px(0) - self.offset_px[0]),
            Id::HeightLimit => Integer(self.max_px(1) - self.offset_px[1]),
            Id::OffsetXLimit => Integer(self.max_px(0) - self.size_px[0]),
            Id::OffsetYLimit => Integer(self.max_px(1) - self.size_px[1]),
            Id::Width => Integer(self.size_px[0]),
            Id::Height => Integer(self.size_px[1]),
            Id::OffsetX => Integer(self.offset_px[0]),
            Id::OffsetY => Integer(self.offset_px[1]),
            Id::BinningHorizontal => Integer(self.binning[0]),
            Id::BinningVertical => Integer(self.binning[1]),
            Id::PixelFormat => Integer(self.format.code()),
            Id::AcquisitionMode => Integer(self.mode),
            Id::AcquisitionFrameCount => Integer(self.frame_count),
            Id::AcquisitionFrameRateEnable => Integer(self.hold_rate.into()),
            Id::AcquisitionFrameRate => Float(self.rate_hz),
            Id::ExposureTime => Float(self.exposure_us),
            Id::TriggerMode => Integer(self.triggered.into()),
            Id::TriggersMissed => Integer(self.triggers_missed),
            Id::Gain => Float(self.gain_db),
            Id::PayloadSize => Integer(self.payload_bytes() as u32),
            Id::TLParamsLocked => Integer(self.locked),
            Id::AcquisitionStart
            | Id::AcquisitionStop
            | Id::TriggerSoftware
            | Id::ExposureMode
            | Id::TriggerSelector
            | Id::TriggerSource => Integer(0),
        }
    }

    /// Sets a feature that is no command.
    pub(crate) fn set(&mut self, feature: &Feature, value: Value) -> Result<(), Status> {
        let inside = match (feature.kind, value) {
            (Kind::Integer { min, max, .. }, Value::Integer(value)) => {
                let max = match max {
                    Limit::Is(max) => max,
                    Limit::Of(id) => match self.get(id, 0.0) {
                        Value::Integer(max) => i64::from(max),
                        Value::Float(_) => return Err(Status::InvalidParameter),
                    },
                };
                (min..=max).contains(&i64::from(value))
            }
            (Kind::Float { min, max, .. }, Value::Float(value)) => (min..=max).contains(&value),
            (Kind::Switch, Value::Integer(value)) => value <= 1,
            (Kind::Choice(choices), Value::Integer(value)) => choices.iter().any(|(_, code)| *code == value),
            _ => false,
        };
        if !inside {
            return Err(Status::InvalidParameter);
        }
        match (feature.id, value) {
            (Id::DeviceLinkThroughputLimit, Value::Integer(value)) => self.bytes_per_s = value,
            (Id::Width, Value::Integer(value)) => self.size_px[0] = value,
            (Id::Height, Value::Integer(value)) => self.size_px[1] = value,
            (Id::OffsetX, Value::Integer(value)) => self.offset_px[0] = value,
            (Id::OffsetY, Value::Integer(value)) => self.offset_px[1] = value,
            (Id::BinningHorizontal, Value::Integer(value)) => self.bin(0, value),
            (Id::BinningVertical, Value::Integer(value)) => self.bin(1, value),
            (Id::PixelFormat, Value::Integer(value)) => {
                self.format = PixelFormat::from_code(value).ok_or(Status::InvalidParameter)?;
            }
            (Id::AcquisitionMode, Value::Integer(value)) => self.mode = value,
            (Id::AcquisitionFrameCount, Value::Integer(value)) => self.frame_count = value,
            (Id::AcquisitionFrameRateEnable, Value::Integer(value)) => self.hold_rate = value == 1,
            (Id::AcquisitionFrameRate, Value::Float(value)) => self.rate_hz = value,
            (Id::ExposureTime, Value::Float(value)) => self.exposure_us = value,
            (Id::TriggerMode, Value::Integer(value)) => self.triggered = value == 1,
            (Id::Gain, Value::Float(value)) => self.gain_db = value,
            (Id::TLParamsLocked, Value::Integer(value)) => self.locked = value,
            // One choice only.
            (Id::ExposureMode | Id::TriggerSelector | Id::TriggerSource, _) => {}
            _ => return Err(Status::WriteProtect),
        }
        Ok(())
    }

    /// Another binning shows the whole sensor again.
    fn bin(&mut self, axis: usize, binning: u32) {
        if self.binning[axis] != binning {
            self.binning[axis] = binning;
            self.size_px[axis] = self.max_px(axis);
            self.offset_px[axis] = 0;
        }
    }

    /// The image on the wire of the sensor's counts: binned, cut out, and no more than its bits hold.
    pub(crate) fn image(&self, counts: &[u16], info: &CameraInfo) -> Vec<u8> {
        let ([width, height], [left, top], [bin_x, bin_y]) = (
            self.size_px.map(|v| v as usize),
            self.offset_px.map(|v| v as usize),
            self.binning.map(|v| v as usize),
        );
        let sensor_width = info.width_px as usize;
        let mut image = Vec::with_capacity(width * height);
        let most = (1u32 << info.bits) - 1;
        for y in top..top + height {
            if bin_x == 1 && bin_y == 1 {
                image.extend_from_slice(&counts[y * sensor_width + left..][..width]);
                continue;
            }
            for x in left..left + width {
                let sum: u32 = (0..bin_y)
                    .flat_map(|j| &counts[(y * bin_y + j) * sensor_width + x * bin_x..][..bin_x])
                    .map(|&count| u32::from(count))
                    .sum();
                let offsets = (bin_x * bin_y - 1) as u32 * u32::from(info.offset_dn);
                image.push(sum.saturating_sub(offsets).min(most) as u16);
            }
        }
        self.format.encode(&image, info.bits)
    }
}

#[cfg(test)]
pub(crate) fn test_info() -> CameraInfo {
    CameraInfo {
        model: "test".into(),
        serial: "1".into(),
        width_px: 64,
        height_px: 48,
        bits: 12,
        offset_dn: 32,
        longest_exposure_s: 1.0,
        knobs: vec![crate::Knob {
            name: "Focus".into(),
            meaning: "Focus of the screen".into(),
            unit: "mm".into(),
            range: [-1.0, 1.0],
            value: 0.25,
        }],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_keep_their_limits() {
        let info = test_info();
        let features = table(&info);
        let mut settings = Settings::new(&info);
        let mut set = |id: Id, value| settings.set(&features[id as usize], value);
        assert_eq!(set(Id::OffsetX, Value::Integer(1)), Err(Status::InvalidParameter));
        assert_eq!(set(Id::Width, Value::Integer(32)), Ok(()));
        assert_eq!(set(Id::OffsetX, Value::Integer(32)), Ok(()));
        assert_eq!(set(Id::Width, Value::Integer(33)), Err(Status::InvalidParameter));
        assert_eq!(set(Id::ExposureTime, Value::Float(f64::NAN)), Err(Status::InvalidParameter));
        assert_eq!(set(Id::ExposureTime, Value::Integer(20)), Err(Status::InvalidParameter));
        assert_eq!(set(Id::PixelFormat, Value::Integer(7)), Err(Status::InvalidParameter));
        assert_eq!(set(Id::SensorWidth, Value::Integer(64)), Err(Status::WriteProtect));
        assert_eq!(set(Id::BinningHorizontal, Value::Integer(2)), Ok(()));
        assert_eq!(settings.get(Id::Width, 0.0), Value::Integer(32));
        assert_eq!(settings.get(Id::OffsetXLimit, 0.0), Value::Integer(0));
    }

    #[test]
    fn images_are_cut_out_and_binned() {
        let info = test_info();
        let counts: Vec<u16> = (0..64 * 48).map(|i| 32 + (i % 64) as u16).collect();
        let mut settings = Settings::new(&info);
        settings.size_px = [2, 1];
        settings.offset_px = [3, 5];
        assert_eq!(settings.image(&counts, &info), [35, 0, 36, 0]);
        // Four pixels' light above one offset: 6 + 7 twice.
        settings.binning = [2, 2];
        settings.size_px = [1, 1];
        assert_eq!(settings.image(&counts, &info), [32 + 26, 0]);
    }
}
