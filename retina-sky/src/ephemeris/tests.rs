use super::*;
use crate::time::parse_epoch;

#[test]
fn earth_and_moon_agree_with_sofas_published_checks() {
    // t_sofa_c.c, iauMoon98 (JD 2400000.5 + 43999.9) and iauEpv00 (+ 53411.52501161).
    let epoch_s = |mjd: f64| (mjd + 2_400_000.5 - J2000_JD) * DAY_S;
    let moon = Ephemeris::analytic().moon_from_earth(epoch_s(43_999.9)).unwrap();
    let expected_au =
        DVec3::new(-2.601_295_959_971_044e-3, 6.139_750_944_302_742e-4, 2.640_794_528_229_828e-4);
    assert!((moon.position_m - expected_au * ASTRONOMICAL_UNIT_M).length() < 0.1);
    let bodies = Ephemeris::analytic().solar_system(epoch_s(53_411.525_011_61)).unwrap();
    let expected_au = DVec3::new(-0.775_723_880_929_770_7, 0.559_805_224_136_334, 0.242_699_846_648_168_7);
    let heliocentric_m = bodies.earth.position_m - bodies.sun.position_m;
    assert!((heliocentric_m - expected_au * ASTRONOMICAL_UNIT_M).length() < 1.0);
}

#[test]
fn the_moon_of_meeus_example_47a() {
    // 1992 April 12, 0h TD: distance 368409.7 km, longitude 133.162655 and latitude -3.229126 deg
    // of the mean ecliptic and equinox of date; precessed to J2000 the longitude gains
    // 5029.0966 arcsec a century (IAU 1976) times 0.0772.
    let tdb_s = parse_epoch("1992-04-12").unwrap();
    let moon_m = Ephemeris::analytic().moon_from_earth(tdb_s).unwrap().position_m;
    assert!((moon_m.length() - 368_409_700.0).abs() < 1000.0);
    let precessed_deg = 133.162_655 - 5029.0966 / 3600.0 * (tdb_s / DAY_S / CENTURY_D);
    assert!((ecliptic_longitude_rad(moon_m).to_degrees() - precessed_deg).abs() < 1e-3);
}

#[test]
fn velocities_are_the_rates_of_the_positions() {
    let (t, h) = (parse_epoch("2027-08-02").unwrap(), 60.0);
    let pick: [fn(&SolarSystem) -> State; 3] = [|b| b.sun, |b| b.earth, |b| b.moon];
    let [before, now, after] = [t - h, t, t + h].map(|t| Ephemeris::analytic().solar_system(t).unwrap());
    for state in pick {
        let rate_m_s = (state(&after).position_m - state(&before).position_m) / (2.0 * h);
        let off_m_s = (rate_m_s - state(&now).velocity_m_s).length();
        assert!(off_m_s < 5e-3, "{off_m_s}");
    }
}

#[test]
fn new_moons_of_published_solar_eclipses() {
    // Times of new Moon to the minute (UT), U.S. Naval Observatory, phases of the Moon.
    for (after, published) in [
        ("2026-08-01", "2026-08-12T17:37Z"),
        ("2026-08-12T12:00", "2026-08-12T17:37Z"),
        ("2027-07-10", "2027-08-02T10:05Z"),
        ("2028-01-01", "2028-01-26T15:12Z"),
        ("2017-07-24", "2017-08-21T18:30Z"),
    ] {
        let found_s = Ephemeris::analytic().next_new_moon_s(parse_epoch(after).unwrap()).unwrap();
        let off_s = found_s - parse_epoch(published).unwrap();
        assert!(off_s.abs() < 60.0, "{published}: {off_s} s");
    }
}

#[test]
fn the_sun_is_seen_where_it_was_one_light_time_ago() {
    let tdb_s = parse_epoch("2027-08-02").unwrap();
    let bodies = Ephemeris::analytic().solar_system(tdb_s).unwrap();
    let geometric_m = bodies.sun.position_m - bodies.moon.position_m;
    let earlier = Ephemeris::analytic().solar_system(tdb_s - geometric_m.length() / LIGHT_SPEED_M_S).unwrap();
    let seen_m = Ephemeris::analytic().sun_from_body_m("moon", tdb_s).unwrap().unwrap();
    assert!((seen_m - (earlier.sun.position_m - bodies.moon.position_m)).length() < 10.0);
    assert!((seen_m - geometric_m).length() > 5000.0);
    assert_eq!(Ephemeris::analytic().sun_from_body_m("phobos", tdb_s).unwrap(), None);
}

#[test]
fn epochs_outside_the_theories_are_refused() {
    for tdb_s in [3.2e9, -3.2e9, f64::NAN, f64::INFINITY] {
        assert!(
            Ephemeris::analytic().solar_system(tdb_s).is_err()
                && Ephemeris::analytic().moon_from_earth(tdb_s).is_err()
        );
    }
    assert!(Ephemeris::analytic().moon_from_earth(3.2e9).unwrap_err().to_string().contains("2101"));
}
