//! A display that is shown nothing brighter or longer than its limits allow.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use retina_bench::ScreenImage;
use retina_geometry::{ScreenLimits, Setup};

use super::Screen;
use super::dose::{Dose, Light};
use crate::LabError;

/// What was shown is written to the log after so long, s; a killed program loses no more.
const SAVED_EVERY: Duration = Duration::from_secs(60);
/// As [`SAVED_EVERY`], where the display is dark: the work is over, perhaps.
const SAVED_IN_THE_DARK: Duration = Duration::from_secs(5);

/// A screen within `screen.limits` of a setup. A thread of its own darkens what stands too long.
pub(crate) struct Guarded {
    shared: Arc<Shared>,
    watch: Option<JoinHandle<()>>,
}

struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

struct State {
    screen: Box<dyn Screen>,
    name: String,
    limits: ScreenLimits,
    dose: Dose,
    /// The last frame that was asked for, and its light.
    image: Option<(ScreenImage, Light)>,
    /// Since when the last frame's light is not yet counted; none while the display is dark.
    lit_since: Option<Instant>,
    /// When the display goes dark.
    until: Option<Instant>,
    /// The thread darkened the last frame.
    darkened: bool,
    saved: Instant,
    end: bool,
}

impl Guarded {
    /// `counted`: what is shown adds up in the setup's log. A virtual display does not burn in.
    pub(crate) fn new(
        screen: Box<dyn Screen>,
        name: &str,
        setup: &Setup,
        counted: bool,
    ) -> Result<Self, LabError> {
        let limits = setup.screen.limits.clone();
        let folder = limits.log.as_ref().filter(|_| counted);
        let folder = folder.map(|log| setup.file.parent().unwrap_or(std::path::Path::new("")).join(log));
        let size_px = [setup.screen.width_px, setup.screen.height_px];
        let state = State {
            screen,
            name: name.into(),
            limits,
            dose: Dose::open(folder, size_px, setup.response_gamma())?,
            image: None,
            lit_since: None,
            until: None,
            darkened: false,
            saved: Instant::now(),
            end: false,
        };
        let shared = Arc::new(Shared { state: Mutex::new(state), changed: Condvar::new() });
        let watched = Arc::clone(&shared);
        let watch = Some(std::thread::spawn(move || watched.watch()));
        Ok(Self { shared, watch })
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Darkens the display when its time is over, until the end.
    fn watch(&self) {
        let mut state = self.lock();
        while !state.end {
            let left = state.until.map(|until| until.saturating_duration_since(Instant::now()));
            if left == Some(Duration::ZERO) {
                state.darken();
                continue;
            }
            state = match left {
                None => self.changed.wait(state).unwrap_or_else(PoisonError::into_inner),
                Some(left) => {
                    self.changed.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0
                }
            };
        }
    }
}

impl State {
    fn refused(&self, problem: String) -> LabError {
        LabError::Display { display: self.name.clone(), problem }
    }

    /// Adds up the light of what is shown until now.
    fn count(&mut self) {
        if let (Some(since), Some((_, light))) = (self.lit_since, &self.image) {
            let now = Instant::now();
            self.dose.add(light, (now - since).as_secs_f64());
            self.lit_since = Some(now);
        }
    }

    /// Time is over. Where the display does not follow, the next call says why.
    fn darken(&mut self) {
        self.count();
        self.until = None;
        if let Some((image, _)) = &self.image
            && self.screen.show(&ScreenImage::dark(image.width_px, image.height_px)).is_ok()
        {
            self.darkened = true;
            self.lit_since = None;
        }
    }

    fn stand(&mut self) {
        self.until =
            self.limits.longest_s.map(|longest_s| Instant::now() + Duration::from_secs_f64(longest_s));
    }

    fn show(&mut self, image: &ScreenImage) -> Result<(), LabError> {
        let light = self.dose.light(image);
        let limits = &self.limits;
        if light.most_count > limits.most_count {
            return Err(self.refused(format!(
                "may show counts up to {} (`screen.limits.most_count`), and a frame has {}. Nothing was shown. Make the \
                 frames again with this setup, or raise the limit",
                limits.most_count, light.most_count
            )));
        }
        if light.mean > limits.most_mean_light {
            return Err(self.refused(format!(
                "may shine with {} of its full light on average (`screen.limits.most_mean_light`), and a frame would with \
                 {:.3}. Nothing was shown. Show darker frames, or raise the limit",
                limits.most_mean_light, light.mean
            )));
        }
        let budget_h = limits.budget_h;
        self.count();
        if let (Some(budget_h), Some((at_px, spent_h))) = (budget_h, self.dose.most_below(&light))
            && spent_h >= budget_h
        {
            return Err(self.refused(format!(
                "has shone near column {}, row {} for all of its burn-in budget of {budget_h} h \
                 (`screen.limits.budget_h`). Use another display with a log of its own, or raise the budget",
                at_px[0], at_px[1]
            )));
        }
        self.screen.show(image)?;
        let lit = light.mean > 0.0;
        self.image = Some((image.clone(), light));
        self.darkened = false;
        self.lit_since = lit.then(Instant::now);
        self.until = None;
        if lit {
            self.stand();
        }
        if self.saved.elapsed() > if lit { SAVED_EVERY } else { SAVED_IN_THE_DARK } {
            self.dose.save()?;
            self.saved = Instant::now();
        }
        Ok(())
    }

    fn hold(&mut self, for_s: f64) -> Result<bool, LabError> {
        if let Some(longest_s) = self.limits.longest_s
            && for_s > longest_s
        {
            return Err(self.refused(format!(
                "shows a frame for {longest_s} s at most (`screen.limits.longest_s`), and the exposure takes {for_s} s. \
                 Expose for a shorter time, or raise the limit"
            )));
        }
        if self.darkened
            && let Some((image, _)) = self.image.take()
        {
            self.show(&image)?;
            return Ok(true);
        }
        if self.until.is_some() {
            self.stand();
        }
        Ok(false)
    }
}

impl Screen for Guarded {
    fn show(&mut self, image: &ScreenImage) -> Result<(), LabError> {
        let shown = self.shared.lock().show(image);
        self.shared.changed.notify_all();
        shown
    }

    fn hold(&mut self, for_s: f64) -> Result<bool, LabError> {
        let held = self.shared.lock().hold(for_s);
        self.shared.changed.notify_all();
        held
    }

    fn is_shown(&self) -> bool {
        !self.shared.lock().darkened
    }

    fn verifies(&self) -> bool {
        self.shared.lock().screen.verifies()
    }

    fn remarks(&self) -> Vec<String> {
        let state = self.shared.lock();
        let mut remarks = state.screen.remarks();
        if let (Some(budget_h), Some((at_px, spent_h))) = (state.limits.budget_h, state.dose.most())
            && spent_h > 0.9 * budget_h
        {
            remarks.push(format!(
                "{:.0} % of its burn-in budget of {budget_h} h are spent near column {}, row {}",
                100.0 * spent_h / budget_h,
                at_px[0],
                at_px[1]
            ));
        }
        remarks
    }
}

impl Drop for Guarded {
    fn drop(&mut self) {
        let mut state = self.shared.lock();
        state.end = true;
        state.count();
        // Where this fails, so did the saving while frames were shown, which has said why.
        let _ = state.dose.save();
        drop(state);
        self.shared.changed.notify_all();
        if let Some(watch) = self.watch.take() {
            let _ = watch.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::{BenchScreen, ScreenView as _};

    fn setup(limits: &str) -> Setup {
        let text = format!(
            "schema = \"retina.setup/1\"\nname = \"small\"\n[screen]\nwidth_px = 32\nheight_px = 16\nwidth_mm = 3.2\n\
             height_mm = 1.6\nbits = 8\n[screen.limits]\n{limits}\n[camera]\nwidth_px = 32\nheight_px = 16\npixel_um = 5\n\
             focal_mm = 10\nf_number = 2\nbits = 12\n[facility]\nobserved_rows_px = 16\n"
        );
        Setup::parse(&text, Path::new("small.toml")).unwrap()
    }

    fn grey(count: u8) -> ScreenImage {
        ScreenImage::grey(32, 16, &[count; 512])
    }

    fn one_pixel(count: u8) -> ScreenImage {
        let mut image = ScreenImage::dark(32, 16);
        image.counts[5] = [count; 3];
        image
    }

    #[test]
    fn brighter_frames_are_refused_and_not_shown() {
        let glass = BenchScreen::new([32, 16]);
        let own = setup("most_count = 200\nmost_mean_light = 0.25");
        let mut screen = Guarded::new(Box::new(glass.clone()), "bench", &own, false).unwrap();
        screen.show(&one_pixel(200)).unwrap();
        for (frame, says) in [(one_pixel(201), "has 201"), (grey(150), "would with 0.311")] {
            let error = screen.show(&frame).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
        assert_eq!(*glass.clone().read().unwrap(), one_pixel(200));
        screen.show(&grey(130)).unwrap();
    }

    #[test]
    fn a_frame_that_nobody_photographs_goes_dark_and_comes_back_for_an_exposure() {
        let glass = BenchScreen::new([32, 16]);
        let own = setup("longest_s = 1");
        let mut screen = Guarded::new(Box::new(glass.clone()), "bench", &own, false).unwrap();
        screen.show(&grey(9)).unwrap();
        std::thread::sleep(Duration::from_millis(700));
        assert!(!screen.hold(0.5).unwrap(), "it is still there");
        std::thread::sleep(Duration::from_millis(600));
        assert!(screen.is_shown(), "an exposure that began 0.6 s ago keeps it");
        std::thread::sleep(Duration::from_millis(900));
        assert!(!screen.is_shown());
        assert_eq!(*glass.clone().read().unwrap(), ScreenImage::dark(32, 16));
        assert!(screen.hold(0.5).unwrap(), "shown again");
        assert_eq!(*glass.clone().read().unwrap(), grey(9));
        assert!(screen.hold(2.0).unwrap_err().to_string().contains("takes 2 s"));
    }

    #[test]
    fn a_budget_adds_up_over_runs_and_is_kept_by_place() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("log");
        let limits = format!("budget_h = {}\nlog = {:?}", 0.3 / 3600.0, log.display().to_string());
        let open =
            || Guarded::new(Box::new(BenchScreen::new([32, 16])), "x11::1", &setup(&limits), true).unwrap();
        for _ in 0..2 {
            let mut screen = open();
            screen.show(&one_pixel(255)).unwrap();
            std::thread::sleep(Duration::from_millis(200));
        }
        let mut screen = open();
        let error = screen.show(&one_pixel(255)).unwrap_err().to_string();
        assert!(error.contains("near column 8, row 8"), "{error}");
        // The other half of the display has never shone.
        let mut other = ScreenImage::dark(32, 16);
        other.counts[20] = [255; 3];
        screen.show(&other).unwrap();
        let error = Guarded::new(Box::new(BenchScreen::new([32, 16])), "x11::1", &setup(&limits), true).err();
        assert!(error.unwrap().to_string().contains("another program"));
    }
}
