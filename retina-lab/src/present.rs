//! Showing a sequence on a screen, to whoever looks.

use std::time::{Duration, Instant};

use retina_files::InputError;

use crate::{LabError, Screen, Sequence};

/// How a sequence is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PresentOptions {
    /// Time from one frame to the next, s.
    pub each_s: f64,
    /// How many times the sequence is shown; until it is stopped where absent.
    pub times: Option<u32>,
}

/// What was shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Presented {
    /// Frames.
    pub frames: usize,
    /// Frames that came later than they were due: reading, showing and verifying them took longer than `each_s`.
    pub late: usize,
    /// It was stopped before its end.
    pub stopped: bool,
}

/// A stop is heard within this time, s.
const LISTEN_S: f64 = 0.05;

/// Shows the frames of a sequence one after the other, each until the next is due. Frames are read while the one before
/// is shown. `progress` hears the number of frames shown; `stop` ends it.
///
/// # Errors
/// A frame does not read or has another size than the screen; the screen fails, or its limits do not allow a frame for
/// so long.
pub fn present(
    sequence: &Sequence,
    screen: &mut dyn Screen,
    options: PresentOptions,
    stop: &dyn Fn() -> bool,
    mut progress: impl FnMut(usize),
) -> Result<Presented, LabError> {
    if let Some(frame) = sequence.frames.iter().find(|frame| !frame.parts.is_empty()) {
        return Err(InputError::new(&frame.file, "is shown by several screens within one exposure")
            .help("`retina lab capture` shows such frames; the screens themselves are a sequence, too")
            .into());
    }
    let wait_until = |due: Instant| {
        while Instant::now() < due && !stop() {
            let left_s = due.saturating_duration_since(Instant::now()).as_secs_f64();
            std::thread::sleep(Duration::from_secs_f64(left_s.min(LISTEN_S)));
        }
    };
    let mut done = Presented { frames: 0, late: 0, stopped: false };
    let mut due = Instant::now();
    let mut round = 0;
    while options.times.is_none_or(|times| round < times) && !sequence.frames.is_empty() {
        for frame in &sequence.frames {
            let image = frame.image()?;
            wait_until(due);
            if stop() {
                return Ok(Presented { stopped: true, ..done });
            }
            let late_s = due.elapsed().as_secs_f64();
            done.late += usize::from(done.frames > 0 && late_s > LISTEN_S.min(0.1 * options.each_s));
            screen.show(&image)?;
            screen.hold(options.each_s)?;
            done.frames += 1;
            progress(done.frames);
            due = Instant::now() + Duration::from_secs_f64(options.each_s);
        }
        round += 1;
    }
    // The last one stays as long as the others.
    wait_until(due);
    Ok(Presented { stopped: stop(), ..done })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BenchScreen, SequenceFrame, SequenceKind};
    use retina_bench::ScreenImage;
    use std::cell::Cell;

    /// A screen that notes when what came.
    struct Noted(BenchScreen, Vec<(Instant, [u8; 3])>);

    impl Screen for Noted {
        fn show(&mut self, image: &ScreenImage) -> Result<(), LabError> {
            self.1.push((Instant::now(), image.counts[0]));
            self.0.show(image)
        }

        fn verifies(&self) -> bool {
            true
        }
    }

    #[test]
    fn frames_come_in_order_each_for_its_time_until_it_is_stopped() {
        let dir = tempfile::tempdir().unwrap();
        let frames = (0..3u8)
            .map(|at| {
                let file = dir.path().join(format!("{at}.png"));
                let image = ScreenImage::grey(4, 2, &[10 * at + 1; 8]);
                let bytes = crate::show::png(&image).unwrap();
                std::fs::write(&file, bytes).unwrap();
                SequenceFrame {
                    name: at.to_string(),
                    file,
                    exposure_ratio: 1.0,
                    exposure_s: None,
                    planned: crate::Planned::default(),
                    parts: Vec::new(),
                }
            })
            .collect();
        let sequence = Sequence { kind: SequenceKind::Frames, frames };
        let mut screen = Noted(BenchScreen::new([4, 2]), Vec::new());
        let options = PresentOptions { each_s: 0.03, times: Some(2) };
        let start = Instant::now();
        let done = present(&sequence, &mut screen, options, &|| false, |_| {}).unwrap();
        assert!(start.elapsed().as_secs_f64() >= 6.0 * 0.03);
        let shown: Vec<u8> = screen.1.iter().map(|(_, counts)| counts[0]).collect();
        assert_eq!((shown, done.frames, done.stopped), (vec![1, 11, 21, 1, 11, 21], 6, false));
        assert!(screen.1.windows(2).all(|pair| (pair[1].0 - pair[0].0).as_secs_f64() > 0.029));
        let count = Cell::new(0);
        let options = PresentOptions { times: None, ..options };
        let stop = || count.get() == 4;
        let done = present(&sequence, &mut screen, options, &stop, |shown| count.set(shown)).unwrap();
        assert_eq!((done.frames, done.stopped), (4, true));
    }
}
