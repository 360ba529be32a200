//! What is wrong with a bench: physical quantities, each at the place where it acts. All 0 by default.

/// How the display stands in its mount, and its figure.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ScreenPlacement {
    /// Its centre beside the optical axis, mm along x and y.
    pub shift_mm: [f64; 2],
    /// Its turn about the axis, rad, from +x towards +y.
    pub turn_rad: f64,
    /// Its tilts: positive raises (moves away from the lenses) the side of +x, of +y, rad.
    pub tilt_rad: [f64; 2],
    /// Its distance behind the design's image surface, mm.
    pub focus_mm: f64,
    /// A bow: sag a (x^2 - y^2) + b x y, 1/mm.
    pub bow_per_mm: [f64; 2],
}

impl ScreenPlacement {
    /// Where a point of the display (mm from its centre) stands: x and y from the axis, and the distance
    /// behind the image surface, mm.
    pub fn place(&self, [u, v]: [f64; 2]) -> [f64; 3] {
        let (sin, cos) = self.turn_rad.sin_cos();
        let [tilt_x, tilt_y] = self.tilt_rad;
        // Tilted about its centre; then turned about the axis.
        let (x, y) = (u * tilt_x.cos(), v * tilt_y.cos());
        let z = u * tilt_x.sin()
            + v * tilt_y.sin()
            + self.bow_per_mm[0] * (u * u - v * v)
            + self.bow_per_mm[1] * u * v;
        [x * cos - y * sin + self.shift_mm[0], x * sin + y * cos + self.shift_mm[1], z + self.focus_mm]
    }
}

/// What the camera's objective does beyond an ideal lens.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Objective {
    /// Coma that grows with the field: the Zernike coefficient (unnormalised, Z = (3 r^2 - 2) r cos) for
    /// each unit of tan(field), mm of path.
    pub coma_mm: f64,
    /// Coma all over the field, of a lens out of line, along x and y, mm.
    pub coma_offset_mm: [f64; 2],
    /// Its distortion of fifth order: r (1 + k r^4), r = tan(field).
    pub radial_r4: f64,
    /// Relative change of its focal length from 475 to 605 nm: lateral colour.
    pub lateral_colour: f64,
    /// Deviation from 475 to 605 nm of a wedge, rad along x and y.
    pub wedge_rad: [f64; 2],
    /// A wedge in the collimated beam: its deviation's second-order part, (a, b) r^2 of tangents.
    pub prism: [f64; 2],
    /// A lens out of line: decentring p1, p2 of tangents (Brown).
    pub decentring: [f64; 2],
}

/// A group of lenses beside where the design has it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GroupOffset {
    /// Along x and y, mm.
    pub shift_mm: [f64; 2],
    /// Right-handed turns about x and y through the group's pivot, rad.
    pub tilt_rad: [f64; 2],
}

/// Everything that can be wrong with a bench and does not change from exposure to exposure.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Imperfections {
    /// The display.
    pub screen: ScreenPlacement,
    /// The camera's boresight beside the facility's axis: towards +x and +y, rad.
    pub pointing_rad: [f64; 2],
    /// The camera's turn about its boresight, rad.
    pub camera_roll_rad: f64,
    /// Its objective.
    pub objective: Objective,
    /// The relay: the prescription's group of this name.
    pub relay: GroupOffset,
    /// Part of the camera's pixel that is sensitive, along each axis; 0 stands for all of it.
    pub pixel_fill: f64,
    /// Clear part of each lens's semi-diameter; 0 stands for the prescription's own.
    pub clear_fraction: f64,
    /// Light that falls on the sensor from elsewhere: electrons a second at the centre, and its rise to
    /// the right and lower edge.
    pub stray_e_s: [f64; 3],
    /// Response of the sensor: signal (1 + a signal / full well).
    pub nonlinearity: f64,
    /// Charge above full well that goes to the neighbours of the column, 0 to 1.
    pub blooming: f64,
}
