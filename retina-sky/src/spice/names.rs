//! NAIF's numbers of bodies by name.

use super::text::Pool;

/// Planets, moons and small bodies with published maps or shapes (NAIF, NAIF Integer ID codes).
const NUMBERS: [(&str, i32); 40] = [
    ("sun", 10),
    ("mercury", 199),
    ("venus", 299),
    ("earth", 399),
    ("moon", 301),
    ("mars", 499),
    ("phobos", 401),
    ("deimos", 402),
    ("jupiter", 599),
    ("io", 501),
    ("europa", 502),
    ("ganymede", 503),
    ("callisto", 504),
    ("amalthea", 505),
    ("saturn", 699),
    ("mimas", 601),
    ("enceladus", 602),
    ("tethys", 603),
    ("dione", 604),
    ("rhea", 605),
    ("titan", 606),
    ("hyperion", 607),
    ("iapetus", 608),
    ("phoebe", 609),
    ("uranus", 799),
    ("ariel", 701),
    ("umbriel", 702),
    ("titania", 703),
    ("oberon", 704),
    ("miranda", 705),
    ("neptune", 899),
    ("triton", 801),
    ("pluto", 999),
    ("charon", 901),
    ("ceres", 2_000_001),
    ("vesta", 2_000_004),
    ("eros", 2_000_433),
    ("itokawa", 2_025_143),
    ("bennu", 2_101_955),
    ("ryugu", 2_162_173),
];

/// The number of a body: one that a kernel names (`NAIF_BODY_NAME`, `NAIF_BODY_CODE`), or one of NAIF's own.
pub(super) fn number(pool: &Pool, name: &str) -> Option<i32> {
    let names = pool.texts("NAIF_BODY_NAME").ok().flatten().unwrap_or_default();
    let codes = pool.numbers("NAIF_BODY_CODE", 1..=usize::MAX).ok().flatten().unwrap_or_default();
    let own = names.into_iter().zip(codes).rev();
    let plain = |name: &str| name.trim().replace('_', " ");
    own.filter(|(own, code)| plain(own).eq_ignore_ascii_case(&plain(name)) && code.fract() == 0.0)
        .map(|(_, code)| code as i32)
        .next()
        .or_else(|| NUMBERS.iter().find(|(own, _)| own.eq_ignore_ascii_case(name)).map(|(_, number)| *number))
}

/// A body's name by NAIF's number.
pub(super) fn name(number: i32) -> String {
    let own = NUMBERS.iter().find(|(_, own)| *own == number);
    own.map_or_else(|| format!("body {number}"), |(name, _)| format!("{name} (NAIF {number})"))
}
