//! What one kernel holds, in words: for whoever wants to know before a scene names it.

use std::collections::BTreeMap;
use std::path::Path;

use retina_files::{InputError, read_bytes};

use super::text::Pool;
use super::{bpc, check_text, ck, clock, constants, frames, leap, meta, names};
use crate::ephemeris::{SPK_KIND, spk_spans};
use crate::time::format_epoch_tdb;

/// Most names in a sentence.
const MOST_NAMES: usize = 12;

/// What a kernel holds, a sentence each. It is looked at alone: what it needs of other kernels is not missed here.
///
/// # Errors
/// It cannot be read, is no kernel, or is damaged.
pub fn kernel_contents(path: &Path) -> Result<Vec<String>, InputError> {
    let bytes = read_bytes(path)?;
    if bytes.starts_with(SPK_KIND.identity) {
        return Ok(spans("places", spk_spans(path, &bytes)?));
    }
    if bytes.starts_with(bpc::PCK_KIND.identity) {
        let own = bpc::segments(path, &bytes, 0)?.into_iter().map(|segment| {
            let body = frames::body_of_axes(segment.axes).map(|(body, _)| names::name(body));
            (body.unwrap_or_else(|| format!("axes {}", segment.axes)), segment.span_s)
        });
        return Ok(spans("axes", own.collect()));
    }
    if bytes.starts_with(ck::CK_KIND.identity) {
        let mut own: BTreeMap<i32, [f64; 2]> = BTreeMap::new();
        for segment in ck::segments(path, &bytes, 0)? {
            let span = own.entry(segment.instrument).or_insert(segment.span_ticks);
            *span = [span[0].min(segment.span_ticks[0]), span[1].max(segment.span_ticks[1])];
        }
        let told = |(instrument, [first, last]): (i32, [f64; 2])| {
            format!("attitudes of {instrument} from {first:.0} to {last:.0} ticks of its spacecraft's clock")
        };
        return Ok(own.into_iter().map(told).collect());
    }
    check_text(path, &bytes)?;
    let mut pool = Pool::default();
    pool.read(path, &bytes)?;
    if let Some(named) = meta::named_kernels(path, &pool)? {
        let names =
            named.iter().filter_map(|kernel| Some(kernel.file_name()?.to_string_lossy().into_owned()));
        return Ok(listed("the kernels", names.collect()).into_iter().collect());
    }
    leap::check(&pool)?;
    text_contents(&pool)
}

fn text_contents(pool: &Pool) -> Result<Vec<String>, InputError> {
    let own = constants::constants(pool)?;
    let named = |has: fn(&constants::Constants) -> bool| {
        own.iter().filter(|(_, constants)| has(constants)).map(|(body, _)| names::name(*body)).collect()
    };
    let mut said: Vec<String> =
        listed("pole and prime meridian of", named(|own| own.turning.is_some())).into_iter().collect();
    said.extend(listed("radii of", named(|own| own.radii_km.is_some())));
    let ending = |start: &str, end: &str| -> Vec<String> {
        let inner = |name: &String| Some(name.strip_prefix(start)?.strip_suffix(end)?.to_owned());
        pool.variables.keys().filter_map(inner).collect()
    };
    // A frame's variables go by its number, save for the one that gives the number by its name.
    let frames = pool.variables.keys().filter_map(|name| name.strip_prefix("FRAME_"));
    let frames = frames.filter(|name| !name.starts_with(|c: char| c.is_ascii_digit() || c == '-'));
    said.extend(listed("the frames", frames.map(str::to_owned).collect()));
    said.extend(listed("the axes' frames of", ending("OBJECT_", "_FRAME")));
    for number in ending("SCLK01_COEFFICIENTS_", "") {
        if let Some(own) = number.parse::<i32>().ok().and_then(i32::checked_neg) {
            clock::clock(pool, own)?;
            said.push(format!("the clock of spacecraft {own}"));
        }
    }
    if pool.variables.contains_key("DELTET/DELTA_AT") {
        said.push("the leap seconds, which are RETINA's own".to_owned());
    }
    if let Some(names) = pool.texts("NAIF_BODY_NAME")? {
        said.extend(listed("names of", names.iter().map(|name| (*name).trim().to_owned()).collect()));
    }
    Ok(said)
}

/// Bodies with the epochs that their segments reach over.
fn spans(what: &str, own: Vec<(String, [f64; 2])>) -> Vec<String> {
    let mut joined: BTreeMap<String, [f64; 2]> = BTreeMap::new();
    for (name, span_s) in own {
        let whole_s = joined.entry(name).or_insert(span_s);
        *whole_s = [whole_s[0].min(span_s[0]), whole_s[1].max(span_s[1])];
    }
    // Bodies of one span share a sentence.
    let mut by_span: BTreeMap<[String; 2], Vec<String>> = BTreeMap::new();
    for (name, span_s) in joined {
        by_span.entry(span_s.map(format_epoch_tdb)).or_default().push(name);
    }
    by_span
        .into_iter()
        .flat_map(|([from, to], names)| {
            listed(&format!("{what} of"), names)
                .into_iter()
                .map(move |said| format!("{said}, from {from} to {to}"))
        })
        .collect()
}

fn listed(what: &str, names: Vec<String>) -> Option<String> {
    let more = match names.len().saturating_sub(MOST_NAMES) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    (!names.is_empty()).then(|| format!("{what} {}{more}", names[..names.len().min(MOST_NAMES)].join(", ")))
}
