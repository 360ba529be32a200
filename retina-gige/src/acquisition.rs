//! Taking images and sending them.

use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use crate::camera::Shared;
use crate::control::Acquisition;
use crate::features::Settings;
use crate::imager::{Imager, Shot};
use crate::registers::TICKS_PER_S;
use crate::stream::Block;

/// Between two looks at the temperature while nothing else happens.
const IDLE: Duration = Duration::from_millis(100);
/// Bytes that are sent without a pause: a small part of what a receiver's socket holds.
const BURST_BYTES: usize = 48_000;

/// Takes images whenever the clients' commands ask for them, until the device ends.
pub(crate) fn run(shared: &Shared, mut imager: Box<dyn Imager>) {
    let (mut shots, mut blocks) = (0, 0u16);
    let mut last: Option<(u64, Instant)> = None;
    while let Some((acquisition, settings)) = next(shared, imager.as_ref(), last) {
        let start = Instant::now();
        last = Some((acquisition.number, start));
        let shot = Shot {
            number: shots,
            exposure_s: settings.exposure_us * 1e-6,
            gain: 10f64.powf(settings.gain_db / 20.0),
            knobs: settings.knobs.clone(),
        };
        shots += 1;
        let made = imager.expose(&shot);
        let destination = {
            let mut control = shared.control();
            control.temperature_c = imager.temperature_c();
            // Stopped, or begun anew, while the image was made.
            let Some(current) = control.acquisition.as_mut().filter(|now| now.number == acquisition.number)
            else {
                continue;
            };
            if let Some(left) = &mut current.left {
                *left -= 1;
                if *left == 0 {
                    control.stop();
                }
            }
            (control.destination(), control.ticks(start), control.bootstrap.packet_bytes())
        };
        let (to, timestamp_ticks, packet_bytes) = destination;
        let counts = match made {
            Ok(counts) => counts,
            Err(failure) => {
                let mut statistics = shared.statistics();
                statistics.failed += 1;
                statistics.last_failure = Some(failure);
                continue;
            }
        };
        shared.statistics().taken += 1;
        let Some(to) = to else { continue };
        // Block 0 is no block.
        blocks = if blocks == u16::MAX { 1 } else { blocks + 1 };
        let block = Arc::new(Block {
            id: blocks,
            timestamp_ticks,
            format: settings.format,
            size_px: settings.size_px,
            offset_px: settings.offset_px,
            bytes: settings.image(&counts, &shared.info),
            packet_bytes: packet_bytes as usize,
        });
        shared.keep(Arc::clone(&block));
        send(shared, &block, to, &settings);
        shared.statistics().sent += 1;
    }
}

/// Waits until an image is to be taken; `None` when the device ends. `last` is the acquisition and the start of the
/// image before.
fn next(
    shared: &Shared,
    imager: &dyn Imager,
    last: Option<(u64, Instant)>,
) -> Option<(Acquisition, Settings)> {
    let mut control = shared.control();
    loop {
        if shared.is_stopping() {
            return None;
        }
        control.temperature_c = imager.temperature_c();
        let mut wait = IDLE;
        if let Some(acquisition) = control.acquisition {
            let triggered = control.settings.triggered;
            let early = last
                .filter(|(number, _)| !triggered && *number == acquisition.number)
                .map(|(_, start)| control.settings.period_s() - start.elapsed().as_secs_f64())
                .filter(|&left_s| left_s > 0.0);
            if let Some(left_s) = early {
                wait = wait.min(Duration::from_secs_f64(left_s));
            } else if !triggered || control.triggers > 0 {
                control.triggers = control.triggers.saturating_sub(1);
                return Some((acquisition, control.settings.clone()));
            }
        }
        control = shared.changed.wait_timeout(control, wait).unwrap_or_else(PoisonError::into_inner).0;
    }
}

/// Sends an image's packets no faster than the client has allowed.
fn send(shared: &Shared, block: &Block, to: std::net::SocketAddr, settings: &Settings) {
    let delay_s = {
        let ticks = shared.control().bootstrap.get(crate::registers::STREAM_DELAY);
        f64::from(ticks) / TICKS_PER_S as f64
    };
    let start = Instant::now();
    let (mut sent, mut since_pause) = (0usize, 0usize);
    for number in 0..block.packets() {
        let Some(packet) = block.packet(number) else { break };
        shared.send(&packet, to);
        sent += packet.len();
        since_pause += packet.len();
        if since_pause >= BURST_BYTES || delay_s > 0.0 {
            since_pause = 0;
            let due_s = (sent as f64 / f64::from(settings.bytes_per_s)).max(delay_s * f64::from(number + 1));
            let early_s = due_s - start.elapsed().as_secs_f64();
            if early_s > 0.0 {
                std::thread::sleep(Duration::from_secs_f64(early_s));
            }
        }
    }
}
