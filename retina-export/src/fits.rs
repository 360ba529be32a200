//! FITS: a file a frame, rows from the top, with world coordinates of the gnomonic projection (FITS standard 4.0, section 8;
//! M. R. Calabretta, E. W. Greisen, A&A 395, 2002).

use glam::DVec3;
use image::ImageFormat;
use retina_batch::BatchError;
use retina_files::{FitsHeader, InputError, MOST_IMAGE_PIXELS, decode_image};

use crate::export::Writer;
use crate::frames::Frame;
use crate::out::Out;

pub(crate) struct Fits;

impl Writer for Fits {
    fn add(&mut self, out: &Out, frame: &Frame, _: bool) -> Result<(), BatchError> {
        let radiance = frame.planes.as_ref().and_then(|planes| {
            let (_, values) = planes.channels.iter().find(|(name, _)| name == "Y")?;
            Some((planes.width_px, planes.height_px, values))
        });
        let (mut header, samples) = match radiance {
            Some((width, height, values)) => {
                let mut header = FitsHeader::of_array(-32, &[width, height]);
                header.text("BUNIT", "W m-2 sr-1 nm-1");
                (header, values.iter().flat_map(|value| value.to_be_bytes()).collect())
            }
            None => counts(frame)?,
        };
        world(&mut header, frame);
        out.write(&format!("{:06}.fits", frame.index), &header.with_data(&samples))
    }

    fn finish(&mut self, _: &Out) -> Result<(), BatchError> {
        Ok(())
    }
}

/// The display's counts: one plane of a grey image, three of a coloured one.
fn counts(frame: &Frame) -> Result<(FitsHeader, Vec<u8>), InputError> {
    let name = format!("frame {}", frame.index);
    let decoded =
        decode_image(name.as_ref(), "the screen image", &frame.png, &[ImageFormat::Png], MOST_IMAGE_PIXELS)?;
    let image = decoded.into_rgb8();
    let (width, height) = (image.width() as usize, image.height() as usize);
    let grey = image.pixels().all(|pixel| pixel.0[0] == pixel.0[1] && pixel.0[1] == pixel.0[2]);
    let planes = if grey { 1 } else { 3 };
    let samples = (0..planes).flat_map(|plane| image.pixels().map(move |pixel| pixel.0[plane])).collect();
    let axes = [width, height, planes];
    let mut header = FitsHeader::of_array(8, if grey { &axes[..2] } else { &axes });
    header.text("BUNIT", "count");
    Ok((header, samples))
}

/// World coordinates: the plane touches the sky at the boresight.
fn world(header: &mut FitsHeader, frame: &Frame) {
    let camera = &frame.truth.image_px;
    let axes = frame.inertial_from_camera();
    let boresight = axes.z_axis;
    let ra = boresight.y.atan2(boresight.x);
    let east = DVec3::new(-ra.sin(), ra.cos(), 0.0);
    let north = boresight.cross(east);
    let deg = |axis: DVec3, along: DVec3, focal_px: f64| (axis.dot(along) / focal_px).to_degrees();
    header
        .integer("WCSAXES", 2)
        .text("CTYPE1", "RA---TAN")
        .text("CTYPE2", "DEC--TAN")
        .text("CUNIT1", "deg")
        .text("CUNIT2", "deg")
        .text("RADESYS", "ICRS")
        .real("CRVAL1", ra.to_degrees().rem_euclid(360.0))
        .real("CRVAL2", boresight.z.clamp(-1.0, 1.0).asin().to_degrees())
        // FITS counts the centre of the first pixel as 1.
        .real("CRPIX1", camera.cx + 0.5)
        .real("CRPIX2", camera.cy + 0.5)
        .real("CD1_1", deg(axes.x_axis, east, camera.fx))
        .real("CD1_2", deg(axes.y_axis, east, camera.fy))
        .real("CD2_1", deg(axes.x_axis, north, camera.fx))
        .real("CD2_2", deg(axes.y_axis, north, camera.fy));
    header.real("TDB_S", frame.truth.time_s).integer("FRAME", frame.index as i64);
    header.text("COMPENS", &frame.truth.compensation);
}
