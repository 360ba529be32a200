//! Where the images come from.

/// A number that a client may set and the imager uses: a feature of the category `Bench`.
#[derive(Debug, Clone, PartialEq)]
pub struct Knob {
    /// Name of the feature, in the style of the standard names: `ScreenFocus`.
    pub name: String,
    /// What it does, one line.
    pub meaning: String,
    /// Unit, as the description shows it.
    pub unit: String,
    /// Smallest and largest value.
    pub range: [f64; 2],
    /// Value at the start.
    pub value: f64,
}

/// What a camera says of itself.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraInfo {
    /// Model, at most 31 bytes of ASCII.
    pub model: String,
    /// Serial number, at most 15 bytes of ASCII.
    pub serial: String,
    /// Width of the sensor, px.
    pub width_px: u32,
    /// Height of the sensor, px.
    pub height_px: u32,
    /// Bits of a digital count.
    pub bits: u32,
    /// Digital count of no light: what binning does not sum.
    pub offset_dn: u16,
    /// Longest exposure, s.
    pub longest_exposure_s: f64,
    /// The imager's own features.
    pub knobs: Vec<Knob>,
}

/// One image that is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Shot {
    /// Its number since the device's start: the seed of its noise.
    pub number: u64,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Gain, as a factor on the digital counts.
    pub gain: f64,
    /// Values of [`CameraInfo::knobs`].
    pub knobs: Vec<f64>,
}

/// What takes the images: a virtual bench, a file, a pattern.
pub trait Imager: Send {
    /// Digital counts of the whole sensor, row by row, and no more than its bits hold. The call lasts as long as the
    /// exposure, and longer where the image has to be computed.
    ///
    /// # Errors
    /// A sentence for the device's log; the device sends no image then.
    fn expose(&mut self, shot: &Shot) -> Result<Vec<u16>, String>;

    /// Temperature of the device, degC.
    fn temperature_c(&self) -> f64;
}
