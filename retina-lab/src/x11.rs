//! An X11 display: its root window and how its pixels lie in memory.

use std::io::ErrorKind;
use std::time::Duration;

use retina_bench::ScreenImage;
use x11rb::connection::Connection as _;
use x11rb::errors::ConnectError;
use x11rb::protocol::xproto::{ConnectionExt as _, ImageFormat, ImageOrder, Visualtype, Window};
use x11rb::rust_connection::RustConnection;

use crate::LabError;

/// Where a pixel's bytes hold red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct PixelLayout {
    order: [usize; 3],
}

impl PixelLayout {
    /// The layout of 32-bit pixels with these masks; `None` where a channel has not 8 bits.
    fn of(masks: [u32; 3], lowest_first: bool) -> Option<Self> {
        let mut order = [0; 3];
        for (place, mask) in order.iter_mut().zip(masks) {
            if mask.count_ones() != 8 || mask.trailing_zeros() % 8 != 0 {
                return None;
            }
            let byte = (mask.trailing_zeros() / 8) as usize;
            *place = if lowest_first { byte } else { 3 - byte };
        }
        Some(Self { order })
    }

    fn counts(self, pixel: &[u8]) -> [u8; 3] {
        self.order.map(|place| pixel[place])
    }

    fn bytes(self, counts: [u8; 3]) -> [u8; 4] {
        let mut pixel = [0; 4];
        for (place, count) in self.order.into_iter().zip(counts) {
            pixel[place] = count;
        }
        pixel
    }
}

const TRIALS: usize = 10;
const BETWEEN_TRIALS: Duration = Duration::from_millis(50);

/// A part of a display, in its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Area {
    pub(crate) left: i16,
    pub(crate) top: i16,
    pub(crate) width: u16,
    pub(crate) height: u16,
}

/// Connects. A server that begins anew, as it does when its last client leaves, resets connections for a moment.
fn connect(name: &str) -> Result<(RustConnection, usize), ConnectError> {
    for _ in 0..TRIALS {
        match RustConnection::connect(Some(name)) {
            Err(ConnectError::IoError(error)) if error.kind() == ErrorKind::ConnectionReset => {
                std::thread::sleep(BETWEEN_TRIALS);
            }
            result => return result,
        }
    }
    RustConnection::connect(Some(name))
}

/// An open display.
pub(crate) struct Display {
    name: String,
    pub(crate) connection: RustConnection,
    pub(crate) root: Window,
    pub(crate) depth: u8,
    pub(crate) size_px: [u16; 2],
    layout: PixelLayout,
}

impl Display {
    pub(crate) fn open(name: &str) -> Result<Self, LabError> {
        let broken = |problem: String| LabError::Display { display: name.into(), problem };
        let (connection, number) = connect(name)
            .map_err(|error| broken(format!("cannot be opened: {error}. Is the X server running?")))?;
        let setup = connection.setup();
        let screen = &setup.roots[number];
        let whole = setup
            .pixmap_formats
            .iter()
            .any(|format| format.depth == screen.root_depth && format.bits_per_pixel == 32);
        let visual: Option<&Visualtype> = screen
            .allowed_depths
            .iter()
            .flat_map(|depth| &depth.visuals)
            .find(|visual| visual.visual_id == screen.root_visual);
        let lowest_first = setup.image_byte_order == ImageOrder::LSB_FIRST;
        let layout = visual
            .filter(|_| whole)
            .and_then(|v| PixelLayout::of([v.red_mask, v.green_mask, v.blue_mask], lowest_first))
            .ok_or_else(|| {
                broken(format!(
                    "has a depth of {} bits; RETINA needs 8 bits a channel. Start the server with depth 24",
                    screen.root_depth
                ))
            })?;
        let (root, depth) = (screen.root, screen.root_depth);
        let size_px = [screen.width_in_pixels, screen.height_in_pixels];
        Ok(Self { name: name.into(), connection, root, depth, size_px, layout })
    }

    /// An error about this display.
    pub(crate) fn broken(&self, problem: impl Into<String>) -> LabError {
        LabError::Display { display: self.name.clone(), problem: problem.into() }
    }

    /// An error of the connection.
    pub(crate) fn gone(&self, error: impl std::fmt::Display) -> LabError {
        self.broken(format!("does not answer as it should: {error}"))
    }

    /// The bytes that the display shows in an area, as they are.
    pub(crate) fn shown(&self, area: Area) -> Result<Vec<u8>, LabError> {
        let reply = self
            .connection
            .get_image(
                ImageFormat::Z_PIXMAP,
                self.root,
                area.left,
                area.top,
                area.width,
                area.height,
                u32::MAX,
            )
            .map_err(|error| self.gone(error))?
            .reply()
            .map_err(|error| self.broken(format!("cannot be read: {error}")))?;
        let expected = 4 * usize::from(area.width) * usize::from(area.height);
        if reply.data.len() != expected {
            return Err(self.broken(format!("gave {} bytes of {expected}", reply.data.len())));
        }
        Ok(reply.data)
    }

    /// The screen image of an area's bytes.
    pub(crate) fn image(&self, bytes: &[u8], area: Area) -> ScreenImage {
        ScreenImage {
            width_px: area.width.into(),
            height_px: area.height.into(),
            counts: bytes.chunks_exact(4).map(|pixel| self.layout.counts(pixel)).collect(),
        }
    }

    /// A screen image as the display's bytes; the byte that is no channel is 0.
    pub(crate) fn bytes(&self, image: &ScreenImage) -> Vec<u8> {
        image.counts.iter().flat_map(|&counts| self.layout.bytes(counts)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_read_and_written_in_the_display_s_own_order() {
        let masks = [0xff_0000, 0xff00, 0xff];
        for (lowest_first, bytes) in [(true, [3, 2, 1, 0]), (false, [0, 1, 2, 3])] {
            let layout = PixelLayout::of(masks, lowest_first).unwrap();
            assert_eq!(layout.counts(&bytes), [1, 2, 3]);
            assert_eq!(layout.bytes([1, 2, 3]), bytes);
        }
        // 16 bits, and ten bits a channel.
        assert_eq!(PixelLayout::of([0xf800, 0x7e0, 0x1f], true), None);
        assert_eq!(PixelLayout::of([0x3ff0_0000, 0xf_fc00, 0x3ff], true), None);
    }
}
