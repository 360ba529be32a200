//! GenICam cameras over GigE and USB3, by Aravis.

use std::sync::{LazyLock, Mutex, PoisonError};

use aravis::prelude::*;
use aravis::{AcquisitionMode, Aravis, Buffer, BufferStatus, Camera, PixelFormat, Stream};
use retina_image::{CameraImage, Steps};

use super::{CameraSettings, LabCamera, Taken};
use crate::{FoundCamera, LabError, Screw, Turns};

/// How often an image that came torn, or not at all, is taken again.
const MOST_LOST: u32 = 5;
/// How long an image may take beyond its exposure, s.
const PATIENCE_S: f64 = 10.0;
/// Buffers that wait for images.
const BUFFERS: usize = 3;
/// Formats, the widest first: how Aravis names them and how many bits they hold.
const FORMATS: [(&str, PixelFormat, u32); 5] = [
    ("Mono16", PixelFormat::MONO_16, 16),
    ("Mono12", PixelFormat::MONO_12, 12),
    ("Mono10", PixelFormat::MONO_10, 10),
    ("Mono8", PixelFormat::MONO_8, 8),
    ("Mono12Packed", PixelFormat::MONO_12_PACKED, 12),
];

/// The library's list of devices, which one thread at a time may read.
static LIST: LazyLock<Mutex<Option<Aravis>>> = LazyLock::new(|| Mutex::new(Aravis::initialize().ok()));

/// The cameras that answer.
pub(crate) fn find() -> Vec<FoundCamera> {
    let list = LIST.lock().unwrap_or_else(PoisonError::into_inner);
    let found = list.as_ref().map(Aravis::get_device_list).unwrap_or_default();
    let of = |device: aravis::DeviceInfo| FoundCamera {
        spec: format!("aravis:{}", device.id.to_string_lossy()),
        address: device.address.to_string_lossy().into_owned(),
    };
    found.into_iter().map(of).collect()
}

pub(super) struct AravisCamera {
    camera: Camera,
    stream: Stream,
    name: String,
    settings: CameraSettings,
    /// Bits of the setup's counts.
    bits: u32,
    running: bool,
}

impl AravisCamera {
    pub(super) fn open(name: Option<&str>, bits: u32) -> Result<Self, LabError> {
        let asked = name.unwrap_or("the first camera found").to_owned();
        let refused = |error: aravis::glib::Error| LabError::Camera {
            camera: asked.clone(),
            problem: format!(
                "cannot be opened: {}. `retina lab devices` lists what is there",
                error.message()
            ),
        };
        let camera = Camera::new(name).map_err(refused)?;
        let text = |value: Result<aravis::glib::GString, aravis::glib::Error>| {
            value.map(|text| text.to_string()).unwrap_or_default()
        };
        let name = format!(
            "{} {} {}",
            text(camera.vendor_name()),
            text(camera.model_name()),
            text(camera.device_serial_number())
        );
        let failed = |error: aravis::glib::Error| LabError::Camera {
            camera: name.clone(),
            problem: format!("refuses a software trigger: {}", error.message()),
        };
        let formats = camera.dup_available_pixel_formats_as_strings().map_err(failed)?;
        let available =
            |(wanted, ..): &&(&str, PixelFormat, u32)| formats.iter().any(|found| found.as_str() == *wanted);
        // The setup's own counts where the camera sends them; otherwise as many bits as there are.
        let own = FORMATS.iter().filter(|(.., format_bits)| *format_bits == bits).find(available);
        let Some((format, ..)) = own.or_else(|| FORMATS.iter().find(available)) else {
            let list: Vec<&str> = formats.iter().map(|found| found.as_str()).collect();
            return Err(LabError::Camera {
                camera: name,
                problem: format!("has no grey pixel format that RETINA reads. It has {}", list.join(", ")),
            });
        };
        camera.set_pixel_format_from_string(format).map_err(failed)?;
        camera.set_acquisition_mode(AcquisitionMode::Continuous).map_err(failed)?;
        camera.set_trigger("Software").map_err(failed)?;
        let stream = camera.create_stream().map_err(failed)?;
        let payload = camera.payload().map_err(failed)? as usize;
        for _ in 0..BUFFERS {
            stream.push_buffer(Buffer::new_allocate(payload));
        }
        let settings = CameraSettings { exposure_s: 0.01, gain_db: 0.0 };
        Ok(Self { camera, stream, name, settings, bits, running: false })
    }

    fn failed(&self, what: &str, error: &aravis::glib::Error) -> LabError {
        LabError::Camera { camera: self.name.clone(), problem: format!("{what}: {}", error.message()) }
    }

    /// The image in a buffer that came whole.
    fn image(&self, buffer: &Buffer) -> Result<CameraImage, LabError> {
        let (width, height) = (buffer.image_width() as usize, buffer.image_height() as usize);
        let (data, format) = (buffer.image_data(), buffer.image_pixel_format());
        let bits = FORMATS.iter().find(|(_, known, _)| *known == format).map(|(.., bits)| *bits);
        let pair = |a: u8, b: u8| f32::from(u16::from_le_bytes([a, b]));
        let values: Option<Vec<f32>> = match format {
            PixelFormat::MONO_8 => Some(data.iter().map(|&value| f32::from(value)).collect()),
            PixelFormat::MONO_12_PACKED => Some(
                data.chunks_exact(3)
                    .flat_map(|b| {
                        [
                            u16::from(b[0]) << 4 | u16::from(b[1] & 15),
                            u16::from(b[2]) << 4 | u16::from(b[1] >> 4),
                        ]
                    })
                    .map(f32::from)
                    .collect(),
            ),
            _ if bits.is_some() => Some(data.chunks_exact(2).map(|b| pair(b[0], b[1])).collect()),
            _ => None,
        };
        let (Some(mut values), Some(bits)) = (values, bits) else {
            return Err(LabError::Camera {
                camera: self.name.clone(),
                problem: "sends another pixel format than was set".into(),
            });
        };
        values.truncate(width * height);
        if values.len() < width * height {
            return Err(LabError::Camera {
                camera: self.name.clone(),
                problem: format!("sent {} pixels of {width} x {height}", values.len()),
            });
        }
        let (mut values, mut bits) = (values, bits);
        let step = f32::from(1u16 << (16 - self.bits.min(16)));
        if bits == 16 && step > 1.0 && values.iter().all(|value| value % step == 0.0) {
            // The sensor's counts, shifted up to fill 16 bits.
            values.iter_mut().for_each(|value| *value /= step);
            bits = self.bits;
        }
        Ok(CameraImage {
            width_px: width as u32,
            height_px: height as u32,
            values,
            full_scale_dn: ((1u32 << bits) - 1) as f32,
            steps: Steps::Whole,
        })
    }
}

impl LabCamera for AravisCamera {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn set(&mut self, settings: &CameraSettings) -> Result<(), LabError> {
        let wanted_us = settings.exposure_s * 1e6;
        let (least, most) = self
            .camera
            .exposure_time_bounds()
            .map_err(|error| self.failed("does not tell its exposure times", &error))?;
        if !(least..=most).contains(&wanted_us) {
            return Err(LabError::Camera {
                camera: self.name.clone(),
                problem: format!("cannot expose for {wanted_us} us; it can for {least} to {most} us"),
            });
        }
        self.camera
            .set_exposure_time(wanted_us)
            .map_err(|error| self.failed("refuses the exposure time", &error))?;
        match self.camera.is_gain_available() {
            Ok(true) => {
                self.camera
                    .set_gain(settings.gain_db)
                    .map_err(|error| self.failed("refuses the gain", &error))?;
            }
            _ if settings.gain_db == 0.0 => {}
            _ => {
                return Err(LabError::Camera {
                    camera: self.name.clone(),
                    problem: "has no gain to set".into(),
                });
            }
        }
        let used_us = self
            .camera
            .exposure_time()
            .map_err(|error| self.failed("does not tell its exposure time", &error))?;
        self.settings = CameraSettings { exposure_s: used_us * 1e-6, ..*settings };
        Ok(())
    }

    fn take(&mut self) -> Result<Taken, LabError> {
        if !self.running {
            self.camera.start_acquisition().map_err(|error| self.failed("does not start", &error))?;
            self.running = true;
        }
        let timeout_us = ((self.settings.exposure_s + PATIENCE_S) * 1e6) as u64;
        for lost in 0..=MOST_LOST {
            // What came late belongs to an earlier frame.
            while let Some(late) = self.stream.try_pop_buffer() {
                self.stream.push_buffer(late);
            }
            self.camera.software_trigger().map_err(|error| self.failed("refuses a trigger", &error))?;
            let Some(buffer) = self.stream.timeout_pop_buffer(timeout_us) else { continue };
            let whole = buffer.status() == BufferStatus::Success;
            let taken = if whole { Some(self.image(&buffer)) } else { None };
            let time_s = buffer.timestamp() as f64 * 1e-9;
            self.stream.push_buffer(buffer);
            if let Some(image) = taken {
                let temperature_c = match self.camera.is_feature_available("DeviceTemperature") {
                    Ok(true) => self.camera.float("DeviceTemperature").ok(),
                    _ => None,
                };
                return Ok(Taken {
                    image: image?,
                    time_s,
                    exposure_s: self.settings.exposure_s,
                    temperature_c,
                    lost,
                });
            }
        }
        Err(LabError::Camera {
            camera: self.name.clone(),
            problem: format!(
                "sent no whole image in {} trials. Look at the cable and the network's packet size",
                MOST_LOST + 1
            ),
        })
    }

    fn turn(&mut self, by: &Turns) -> Result<(), LabError> {
        for screw in Screw::ALL.into_iter().filter(|&screw| by.get(screw) != 0.0) {
            let name = screw.name();
            if !matches!(self.camera.is_feature_available(&name), Ok(true)) {
                return Err(LabError::Camera {
                    camera: self.name.clone(),
                    problem: format!("has no feature {name}. Turn the screws by hand: leave --turn out"),
                });
            }
            let refused =
                |error: aravis::glib::Error| self.failed(&format!("refuses to turn {name}"), &error);
            let now = self.camera.float(&name).map_err(refused)?;
            self.camera.set_float(&name, now + by.get(screw)).map_err(refused)?;
        }
        Ok(())
    }
}

impl Drop for AravisCamera {
    fn drop(&mut self) {
        // A camera that is gone has stopped already.
        let _ = self.camera.stop_acquisition();
    }
}
