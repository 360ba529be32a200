//! An X11 display as a screen: its root window, read back.

use std::sync::Arc;

use retina_bench::ScreenImage;
use x11rb::connection::Connection as _;
use x11rb::protocol::xproto::{ConnectionExt as _, ImageFormat, ImageOrder, Visualtype, Window};
use x11rb::rust_connection::RustConnection;

use super::ScreenView;
use crate::LabError;

/// Where a pixel's bytes hold red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PixelLayout {
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
}

pub(crate) struct X11View {
    display: String,
    connection: RustConnection,
    root: Window,
    size_px: [u32; 2],
    layout: PixelLayout,
    /// The last image, and the bytes it was read from.
    shown: Option<(Vec<u8>, Arc<ScreenImage>)>,
}

impl X11View {
    pub(crate) fn open(display: &str, size_px: [u32; 2]) -> Result<Self, LabError> {
        let broken = |problem: String| LabError::Display { display: display.into(), problem };
        let (connection, number) = RustConnection::connect(Some(display))
            .map_err(|error| broken(format!("cannot be opened: {error}. Is the X server running?")))?;
        let setup = connection.setup();
        let screen = &setup.roots[number];
        let found = [screen.width_in_pixels, screen.height_in_pixels].map(u32::from);
        if found != size_px {
            return Err(broken(format!(
                "has {} x {} pixels; the setup's screen has {} x {}. Give the display the screen's mode",
                found[0], found[1], size_px[0], size_px[1]
            )));
        }
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
        let root = screen.root;
        Ok(Self { display: display.into(), connection, root, size_px, layout, shown: None })
    }
}

impl ScreenView for X11View {
    fn read(&mut self) -> Result<Arc<ScreenImage>, LabError> {
        let [width_px, height_px] = self.size_px;
        let broken = |problem: String| LabError::Display { display: self.display.clone(), problem };
        let reply = self
            .connection
            .get_image(ImageFormat::Z_PIXMAP, self.root, 0, 0, width_px as u16, height_px as u16, u32::MAX)
            .map_err(|error| broken(format!("is gone: {error}")))?
            .reply()
            .map_err(|error| broken(format!("cannot be read: {error}")))?;
        if let Some((bytes, image)) = &self.shown
            && *bytes == reply.data
        {
            return Ok(Arc::clone(image));
        }
        let counts: Vec<[u8; 3]> =
            reply.data.chunks_exact(4).map(|pixel| self.layout.counts(pixel)).collect();
        if counts.len() != width_px as usize * height_px as usize {
            return Err(broken(format!("gave {} pixels of {width_px} x {height_px}", counts.len())));
        }
        let image = Arc::new(ScreenImage { width_px, height_px, counts });
        self.shown = Some((reply.data, Arc::clone(&image)));
        Ok(image)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_read_in_the_display_s_own_order() {
        let masks = [0xff_0000, 0xff00, 0xff];
        assert_eq!(PixelLayout::of(masks, true).unwrap().counts(&[3, 2, 1, 0]), [1, 2, 3]);
        assert_eq!(PixelLayout::of(masks, false).unwrap().counts(&[0, 1, 2, 3]), [1, 2, 3]);
        // 16 bits, and ten bits a channel.
        assert_eq!(PixelLayout::of([0xf800, 0x7e0, 0x1f], true), None);
        assert_eq!(PixelLayout::of([0x3ff0_0000, 0xf_fc00, 0x3ff], true), None);
    }
}
