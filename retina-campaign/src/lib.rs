//! Measurement campaigns on the virtual bench.
//!
//! - [`Effect`]: a physical effect by its id and size (`screen_tilt=0.1deg`), set at the place where it acts.
//! - [`Facility`]: a setup with effects: what is wrong with the bench, and what changes in time.
//! - [`simulate_points`], [`simulate_power`], [`simulate_frames`]: the tables that a real facility's
//!   campaigns give.
//! - [`PointsRecord`]: a campaign of points as its file keeps it, to be made again under another condition.
//! - [`simulate_stars`], [`compare_with_sky`]: what a navigation test would see, beside what was meant and beside the sky.

mod effects;
mod facility;
mod frames;
mod points;
mod power;
mod record;
mod sky;
mod sky_page;
mod stars;

pub use effects::{Effect, EffectKind, known_effects};
pub use facility::{Dynamics, Facility, TemperatureProfile};
pub use frames::{
    FramesOptions, FramesResult, adopt_frames, photograph_frames, predicted_by, read_screen, screen_of_png,
    screens_of, simulate_frames, torn_frames, well_exposed_s,
};
pub use points::{
    PointsOptions, PointsResult, camera_image, saturation_dn, screen_image, simulate_plan, simulate_points,
};
pub use power::{PowerOptions, simulate_power};
pub use record::PointsRecord;
pub use sky::{Comparison, SkyObject, SkyOptions, SkyResult, Spot, compare_with_sky};
pub use sky_page::sky_page;
pub use stars::{StarRow, StarsOptions, StarsResult, simulate_stars};
