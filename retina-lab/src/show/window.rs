//! A window over an output of an X11 display.

use std::time::{Duration, Instant};

use retina_bench::ScreenImage;
use x11rb::connection::{Connection as _, RequestConnection as _};
use x11rb::protocol::randr::ConnectionExt as _;
use x11rb::protocol::xproto::{
    Blanking, ChangeWindowAttributesAux, ConfigureWindowAux, ConnectionExt as _, CreateGCAux,
    CreateWindowAux, Exposures, Gcontext, ImageFormat, Pixmap, StackMode, Window as WindowId, WindowClass,
};
use x11rb::wrapper::ConnectionExt as _;

use super::{Screen, check_size};
use crate::x11::{Area, Display};
use crate::{FoundScreen, LabError};

/// Name of the selection whose owner drives an output.
const OWNER: &str = "_RETINA_SCREEN";
/// How long a frame may take until it is read back.
const PATIENCE: Duration = Duration::from_secs(2);
/// Bytes of a request before its pixels.
const REQUEST_HEAD: usize = 64;

pub(crate) struct Window {
    display: Display,
    area: Area,
    window: WindowId,
    /// A frame is put together here, and comes to the window in one piece.
    pixmap: Pixmap,
    context: Gcontext,
    remarks: Vec<String>,
}

impl Window {
    pub(crate) fn open(name: &str, output: Option<&str>, size_px: [u32; 2]) -> Result<Self, LabError> {
        let display = Display::open(name)?;
        let area = area(&display, output, size_px)?;
        claim(&display, area)?;
        let remarks = remarks(&display, area)?;
        let (window, pixmap, context) =
            make(&display, area).map_err(|error| display.broken(format!("refuses a window: {error}")))?;
        Ok(Self { display, area, window, pixmap, context, remarks })
    }

    /// Brings a frame's bytes to the window.
    fn put(&self, bytes: &[u8]) -> Result<(), x11rb::errors::ReplyError> {
        let connection = &self.display.connection;
        let Area { width, height, .. } = self.area;
        let row = 4 * usize::from(width);
        let rows = ((connection.maximum_request_bytes() - REQUEST_HEAD) / row).clamp(1, usize::from(height));
        for (part, pixels) in bytes.chunks(rows * row).enumerate() {
            let (top, tall) = ((part * rows) as i16, (pixels.len() / row) as u16);
            let format = ImageFormat::Z_PIXMAP;
            connection.put_image(
                format,
                self.pixmap,
                self.context,
                width,
                tall,
                0,
                top,
                0,
                self.display.depth,
                pixels,
            )?;
        }
        connection.copy_area(self.pixmap, self.window, self.context, 0, 0, 0, 0, width, height)?;
        connection.sync()
    }
}

/// The part of the display that the window covers.
fn area(display: &Display, output: Option<&str>, size_px: [u32; 2]) -> Result<Area, LabError> {
    let outputs = outputs(display);
    let [width, height] = display.size_px;
    let whole = Area { left: 0, top: 0, width, height };
    let fits = |area: &Area| [area.width, area.height].map(u32::from) == size_px;
    let list = || {
        let named = outputs.iter().map(|(name, area)| format!("{name} {} x {}", area.width, area.height));
        let list: Vec<String> = named.collect();
        if list.is_empty() { "none".to_owned() } else { list.join(", ") }
    };
    let wanted = format!("the setup's screen has {} x {} pixels", size_px[0], size_px[1]);
    match output {
        Some(name) => match outputs.iter().find(|(known, _)| known == name) {
            Some((_, area)) if fits(area) => Ok(*area),
            Some((_, area)) => Err(display.broken(format!(
                "shows {} x {} pixels on {name}; {wanted}. Give the output that mode, without scaling",
                area.width, area.height
            ))),
            None => Err(display.broken(format!("has no output {name}. Its outputs: {}", list()))),
        },
        None if fits(&whole) => Ok(whole),
        None => {
            let mut fitting = outputs.iter().filter(|(_, area)| fits(area));
            match (fitting.next(), fitting.next()) {
                (Some((_, area)), None) => Ok(*area),
                (None, _) => Err(display.broken(format!(
                    "has {width} x {height} pixels and no output that fits; {wanted}. Its outputs: {}",
                    list()
                ))),
                _ => Err(display.broken(format!(
                    "has several outputs that fit: {}. Name one: x11:DISPLAY@OUTPUT",
                    list()
                ))),
            }
        }
    }
}

/// All of a display, and each of its outputs.
pub(crate) fn find(name: &str) -> Result<Vec<FoundScreen>, LabError> {
    let display = Display::open(name)?;
    let [width, height] = display.size_px;
    let whole = (format!("x11:{name}"), Area { left: 0, top: 0, width, height });
    let named = outputs(&display).into_iter().map(|(output, area)| (format!("x11:{name}@{output}"), area));
    let found = |(spec, area): (String, Area)| FoundScreen {
        spec,
        size_px: [area.width, area.height].map(u32::from),
    };
    Ok(std::iter::once(whole).chain(named).map(found).collect())
}

/// Name and place of each output that shows something; none where the server has no RandR.
fn outputs(display: &Display) -> Vec<(String, Area)> {
    let monitors =
        display.connection.randr_get_monitors(display.root, true).ok().and_then(|cookie| cookie.reply().ok());
    let Some(monitors) = monitors else { return Vec::new() };
    let name_of = |atom| {
        let reply = display.connection.get_atom_name(atom).ok()?.reply().ok()?;
        String::from_utf8(reply.name).ok()
    };
    monitors
        .monitors
        .iter()
        .filter_map(|monitor| {
            let area = Area { left: monitor.x, top: monitor.y, width: monitor.width, height: monitor.height };
            Some((name_of(monitor.name)?, area))
        })
        .collect()
}

/// Makes this program the only one of ours that drives the area.
fn claim(display: &Display, area: Area) -> Result<(), LabError> {
    let connection = &display.connection;
    let name = format!("{OWNER}_{}_{}", area.left, area.top);
    let answer = || -> Result<bool, x11rb::errors::ReplyOrIdError> {
        let atom = connection.intern_atom(false, name.as_bytes())?.reply()?.atom;
        if connection.get_selection_owner(atom)?.reply()?.owner != x11rb::NONE {
            return Ok(false);
        }
        // A window that is never shown owns the selection; it goes with the connection.
        let own = connection.generate_id()?;
        connection.create_window(
            0,
            own,
            display.root,
            0,
            0,
            1,
            1,
            0,
            WindowClass::INPUT_ONLY,
            x11rb::COPY_FROM_PARENT,
            &CreateWindowAux::new(),
        )?;
        connection.set_selection_owner(own, atom, x11rb::CURRENT_TIME)?;
        Ok(connection.get_selection_owner(atom)?.reply()?.owner == own)
    };
    match answer() {
        Ok(true) => Ok(()),
        Ok(false) => Err(display.broken("is driven by another program. End that one first")),
        Err(error) => Err(display.gone(error)),
    }
}

/// What changes the light on the way to the glass.
fn remarks(display: &Display, area: Area) -> Result<Vec<String>, LabError> {
    let connection = &display.connection;
    let mut remarks = Vec::new();
    let mut look = || -> Result<(), x11rb::errors::ReplyError> {
        let resources = connection.randr_get_screen_resources_current(display.root)?.reply()?;
        for crtc in resources.crtcs {
            let info = connection.randr_get_crtc_info(crtc, resources.config_timestamp)?.reply()?;
            if (info.x, info.y) != (area.left, area.top) || info.mode == 0 {
                continue;
            }
            let gamma = connection.randr_get_crtc_gamma(crtc)?.reply()?;
            if [&gamma.red, &gamma.green, &gamma.blue].into_iter().any(|ramp| !is_straight(ramp)) {
                remarks.push(
                    "the output's colour table is no straight line: a night light or a colour profile changes the counts. \
                     Switch it off"
                        .into(),
                );
            }
        }
        let atom = connection.intern_atom(true, b"_NET_WM_CM_S0")?.reply()?.atom;
        if atom != x11rb::NONE && connection.get_selection_owner(atom)?.reply()?.owner != x11rb::NONE {
            remarks.push("a compositor draws this display: frames may be late by one. Switch it off".into());
        }
        Ok(())
    };
    // A server without RandR has no colour tables.
    match look() {
        Ok(()) | Err(x11rb::errors::ReplyError::X11Error(_)) => Ok(remarks),
        Err(x11rb::errors::ReplyError::ConnectionError(
            x11rb::errors::ConnectionError::UnsupportedExtension,
        )) => Ok(remarks),
        Err(error) => Err(display.gone(error)),
    }
}

/// Whether a colour table gives each count as it is.
fn is_straight(ramp: &[u16]) -> bool {
    // A virtual server has no output, and its table is whatever its memory held: it does not rise.
    if !ramp.is_sorted() || ramp.first() == ramp.last() {
        return true;
    }
    let last = ramp.len().saturating_sub(1).max(1) as f64;
    ramp.iter().enumerate().all(|(k, &value)| (f64::from(value) - 65535.0 * k as f64 / last).abs() <= 257.0)
}

fn make(
    display: &Display,
    area: Area,
) -> Result<(WindowId, Pixmap, Gcontext), x11rb::errors::ReplyOrIdError> {
    let connection = &display.connection;
    // Nothing but black around and behind: it stays when the window goes.
    connection
        .change_window_attributes(display.root, &ChangeWindowAttributesAux::new().background_pixel(0))?;
    connection.set_screen_saver(0, 0, Blanking::NOT_PREFERRED, Exposures::NOT_ALLOWED)?;
    let mask = connection.generate_id()?;
    let cursor = connection.generate_id()?;
    connection.create_pixmap(1, mask, display.root, 1, 1)?;
    let clear = connection.generate_id()?;
    connection.create_gc(clear, mask, &CreateGCAux::new().foreground(0))?;
    connection.poly_fill_rectangle(
        mask,
        clear,
        &[x11rb::protocol::xproto::Rectangle { x: 0, y: 0, width: 1, height: 1 }],
    )?;
    connection.create_cursor(cursor, mask, mask, 0, 0, 0, 0, 0, 0, 0, 0)?;
    // The pointer must not light the screen, neither now nor when the window is gone.
    connection.change_window_attributes(display.root, &ChangeWindowAttributesAux::new().cursor(cursor))?;
    let window = connection.generate_id()?;
    let attributes = CreateWindowAux::new().background_pixel(0).override_redirect(1).cursor(cursor);
    connection
        .create_window(
            x11rb::COPY_DEPTH_FROM_PARENT,
            window,
            display.root,
            area.left,
            area.top,
            area.width,
            area.height,
            0,
            WindowClass::INPUT_OUTPUT,
            x11rb::COPY_FROM_PARENT,
            &attributes,
        )?
        .check()?;
    let pixmap = connection.generate_id()?;
    connection.create_pixmap(display.depth, pixmap, window, area.width, area.height)?.check()?;
    let context = connection.generate_id()?;
    connection.create_gc(context, pixmap, &CreateGCAux::new().graphics_exposures(0))?.check()?;
    connection.map_window(window)?;
    connection.configure_window(window, &ConfigureWindowAux::new().stack_mode(StackMode::ABOVE))?;
    connection.sync()?;
    Ok((window, pixmap, context))
}

impl Screen for Window {
    fn show(&mut self, image: &ScreenImage) -> Result<(), LabError> {
        check_size(image, [self.area.width, self.area.height].map(u32::from))?;
        let bytes = self.display.bytes(image);
        let start = Instant::now();
        loop {
            self.put(&bytes).map_err(|error| self.display.gone(error))?;
            let shown = self.display.shown(self.area)?;
            // The byte beside the channels is the server's own.
            let differing = self
                .display
                .image(&shown, self.area)
                .counts
                .iter()
                .zip(&image.counts)
                .filter(|(shown, wanted)| shown != wanted)
                .count();
            if differing == 0 {
                return Ok(());
            }
            if start.elapsed() > PATIENCE {
                return Err(self.display.broken(format!(
                    "shows something else in {differing} pixels of the frame: another window lies over it, or a \
                     compositor is at work. Close it"
                )));
            }
            // Another window was raised: ours goes on top again.
            let up = ConfigureWindowAux::new().stack_mode(StackMode::ABOVE);
            self.display
                .connection
                .configure_window(self.window, &up)
                .map_err(|error| self.display.gone(error))?;
        }
    }

    fn verifies(&self) -> bool {
        true
    }

    fn remarks(&self) -> Vec<String> {
        self.remarks.clone()
    }
}

impl Drop for Window {
    fn drop(&mut self) {
        // The window goes with the connection, and the black behind it stays. A server that is gone shows nothing.
        let _ = self.put(&vec![0; 4 * usize::from(self.area.width) * usize::from(self.area.height)]);
        let _ = self.display.connection.destroy_window(self.window);
        let _ = self.display.connection.clear_area(false, self.display.root, 0, 0, 0, 0);
        let _ = self.display.connection.sync();
    }
}

#[cfg(test)]
mod tests {
    use super::is_straight;

    #[test]
    fn a_night_light_is_seen_in_the_colour_table() {
        let straight: Vec<u16> = (0..256).map(|k| (k * 257) as u16).collect();
        assert!(
            is_straight(&straight)
                && is_straight(&[])
                && is_straight(&[0; 256])
                && is_straight(&[8512, 20991, 0, 7])
        );
        let reddish: Vec<u16> = straight.iter().map(|&value| (f64::from(value) * 0.9) as u16).collect();
        assert!(!is_straight(&reddish));
    }
}
