//! What a monitor keeps: the points of its first round, and a line for each round.

use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use glam::DVec2;
use retina_calibration::geometry::Pattern;
use retina_files::{InputError, Table, write_atomic};
use retina_plot::{Axis, Figure, PALETTE, Panel, Style};

use super::MonitorReading;
use crate::LabError;
use crate::spots::Spot;

const REFERENCE: &str = "reference.csv";
const LOG: &str = "monitor.csv";
const HEAD: &str = "unix_s,temperature_c,points,boresight_x_arcsec,boresight_y_arcsec,roll_arcsec,scale_ppm,\
                    rms_arcsec,left_arcsec,width_px,light,alarms";

fn failed(path: &Path, error: impl std::fmt::Display) -> LabError {
    InputError::new(path, format!("cannot be written: {error}")).into()
}

/// A point of the first round.
pub(super) struct ReferencePoint {
    /// Its line of sight, tangents.
    pub(super) sight: DVec2,
    /// Its variance, camera px^2.
    pub(super) variance_px2: f64,
    /// Its light, DN.
    pub(super) flux_dn: f64,
}

/// The first round.
pub(super) struct Reference {
    /// Exposure time, s.
    pub(super) exposure_s: f64,
    /// By the pattern's points.
    pub(super) points: Vec<Option<ReferencePoint>>,
}

impl Reference {
    /// That of an earlier run.
    pub(super) fn read(folder: &Path, pattern: &Pattern) -> Result<Option<Self>, LabError> {
        let path = folder.join(REFERENCE);
        if !path.exists() {
            return Ok(None);
        }
        let table = Table::parse(&path, &retina_files::read_text(&path)?)?;
        let shown = &pattern.screens[0].points;
        let mut exposure_s = 0.0;
        let mut points: Vec<Option<ReferencePoint>> = shown.iter().map(|_| None).collect();
        for row in 0..table.len() {
            let number = |column: &str| table.number(row, column);
            let at = DVec2::new(number("screen_x_px")?, number("screen_y_px")?);
            let Some(place) = shown.iter().position(|point| point.screen_px() == at) else {
                return Err(InputError::new(&path, "is of other reference points")
                    .found(format!("a point at {}, {}", at.x, at.y))
                    .help(
                        "give --out another folder, or the setup and the number of points that it began with",
                    )
                    .into());
            };
            exposure_s = number("exposure_s")?;
            points[place] = Some(ReferencePoint {
                sight: DVec2::new(number("sight_x")?, number("sight_y")?),
                variance_px2: number("variance_px2")?,
                flux_dn: number("flux_dn")?,
            });
        }
        Ok(Some(Self { exposure_s, points }))
    }

    /// Keeps the first round.
    pub(super) fn write(
        folder: &Path,
        pattern: &Pattern,
        exposure_s: f64,
        sights: &[Option<DVec2>],
        spots: &[Option<Spot>],
    ) -> Result<Self, LabError> {
        let mut text =
            String::from("screen_x_px,screen_y_px,exposure_s,sight_x,sight_y,variance_px2,flux_dn\n");
        let mut points = Vec::new();
        for ((point, sight), spot) in pattern.screens[0].points.iter().zip(sights).zip(spots) {
            let (Some(sight), Some(spot)) = (sight, spot) else {
                points.push(None);
                continue;
            };
            let (at, Spot { variance_px2, flux_dn, .. }) = (point.screen_px(), *spot);
            let _ = writeln!(
                text,
                "{},{},{exposure_s},{},{},{variance_px2},{flux_dn}",
                at.x, at.y, sight.x, sight.y
            );
            points.push(Some(ReferencePoint { sight: *sight, variance_px2, flux_dn }));
        }
        let path = folder.join(REFERENCE);
        write_atomic(&path, text.as_bytes()).map_err(|error| failed(&path, error))?;
        Ok(Self { exposure_s, points })
    }
}

/// The rounds so far.
pub(super) struct Log {
    folder: PathBuf,
    pub(super) readings: Vec<MonitorReading>,
}

impl Log {
    pub(super) fn open(folder: &Path) -> Result<Self, LabError> {
        std::fs::create_dir_all(folder).map_err(|error| failed(folder, error))?;
        let path = folder.join(LOG);
        let mut readings = Vec::new();
        if path.exists() {
            let text = retina_files::read_text(&path)?;
            // A line that a killed run did not finish.
            let whole = &text[..text.rfind('\n').map_or(0, |end| end + 1)];
            if whole.len() < text.len() {
                write_atomic(&path, whole.as_bytes()).map_err(|error| failed(&path, error))?;
            }
            if !whole.is_empty() {
                let table = Table::parse(&path, whole)?;
                for row in 0..table.len() {
                    readings.push(reading(&table, row)?);
                }
            }
        }
        Ok(Self { folder: folder.into(), readings })
    }

    /// Adds a line, and draws all of them anew.
    pub(super) fn append(&mut self, reading: &MonitorReading) -> Result<(), LabError> {
        let path = self.folder.join(LOG);
        let cell = |value: f64| if value.is_finite() { value.to_string() } else { String::new() };
        let new = std::fs::metadata(&path).map_or(true, |file| file.len() == 0);
        let mut text = if new { format!("{HEAD}\n") } else { String::new() };
        let _ = writeln!(
            text,
            "{:.3},{},{},{},{},{},{},{},{},{},{},{}",
            reading.unix_s,
            reading.temperature_c.map_or_else(String::new, cell),
            reading.points,
            cell(reading.boresight_arcsec[0]),
            cell(reading.boresight_arcsec[1]),
            cell(reading.roll_arcsec),
            cell(reading.scale_ppm),
            cell(reading.rms_arcsec),
            cell(reading.left_arcsec),
            cell(reading.width_px),
            cell(reading.light),
            reading.alarms.len()
        );
        let mut file =
            OpenOptions::new().create(true).append(true).open(&path).map_err(|error| failed(&path, error))?;
        file.write_all(text.as_bytes())
            .and_then(|()| file.sync_data())
            .map_err(|error| failed(&path, error))?;
        self.readings.push(reading.clone());
        let path = self.folder.join("monitor.svg");
        write_atomic(&path, monitor_figure(&self.readings).to_svg().as_bytes())
            .map_err(|error| failed(&path, error))
    }
}

fn reading(table: &Table, row: usize) -> Result<MonitorReading, InputError> {
    let number = |column: &str| Ok::<_, InputError>(table.number_or_empty(row, column)?.unwrap_or(f64::NAN));
    let alarms = table.number(row, "alarms")? as usize;
    Ok(MonitorReading {
        unix_s: table.number(row, "unix_s")?,
        temperature_c: table.number_or_empty(row, "temperature_c")?,
        points: table.number(row, "points")? as usize,
        boresight_arcsec: [number("boresight_x_arcsec")?, number("boresight_y_arcsec")?],
        roll_arcsec: number("roll_arcsec")?,
        scale_ppm: number("scale_ppm")?,
        rms_arcsec: number("rms_arcsec")?,
        left_arcsec: number("left_arcsec")?,
        width_px: number("width_px")?,
        light: number("light")?,
        alarms: vec![String::from("an alarm of an earlier run"); alarms],
    })
}

/// A point of a curve.
type Value = fn(&MonitorReading) -> f64;

/// Drift over time: shift, error, light and width.
pub fn monitor_figure(readings: &[MonitorReading]) -> Figure {
    let start_s = readings.first().map_or(0.0, |reading| reading.unix_s);
    let panels: [(&str, &[(&str, Value)]); 4] = [
        (
            "shift of the scene (arcsec)",
            &[
                ("along x", |reading| reading.boresight_arcsec[0]),
                ("along y", |reading| reading.boresight_arcsec[1]),
            ],
        ),
        (
            "line of sight error (arcsec)",
            &[
                ("RMS", |reading| reading.rms_arcsec),
                ("without shift, roll, scale", |reading| reading.left_arcsec),
            ],
        ),
        ("light over the first round's", &[("", |reading| reading.light)]),
        ("spot width (px)", &[("", |reading| reading.width_px)]),
    ];
    let mut figure = Figure::new("Drift", 2, 2, [400.0, 260.0]);
    for (place, (label, curves)) in panels.into_iter().enumerate() {
        let mut panel = Panel::new(Axis::linear("time (min)"), Axis::linear(label));
        for (k, (name, value)) in curves.iter().enumerate() {
            let points: Vec<[f64; 2]> = readings
                .iter()
                .map(|reading| [(reading.unix_s - start_s) / 60.0, value(reading)])
                .filter(|point| point[1].is_finite())
                .collect();
            panel.line(name, &points, Style::line(PALETTE[k]));
            panel.dots("", &points, Style::line(PALETTE[k]));
        }
        figure.put(place / 2, place % 2, panel);
    }
    figure
}
