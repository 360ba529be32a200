//! The screws of a bench: what a person in the laboratory turns.

use retina_bench::Imperfections;

/// A degree of freedom of the mounts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Screw {
    /// The screen's +x side away from the lenses, deg.
    ScreenTiltX,
    /// Its +y side away from the lenses, deg.
    ScreenTiltY,
    /// The screen along +x, mm.
    ScreenShiftX,
    /// The screen along +y, mm.
    ScreenShiftY,
    /// The screen about the axis, from +x towards +y, deg.
    ScreenTurn,
    /// The screen away from the lenses, mm.
    ScreenFocus,
    /// The relay's lenses along +x, mm.
    RelayShiftX,
    /// The relay's lenses along +y, mm.
    RelayShiftY,
    /// The relay's lenses about +x, right-handed, deg.
    RelayTiltX,
    /// The relay's lenses about +y, right-handed, deg.
    RelayTiltY,
    /// The camera's boresight towards +x, deg.
    CameraPointingX,
    /// The camera's boresight towards +y, deg.
    CameraPointingY,
    /// The camera about its boresight, deg.
    CameraRoll,
}

impl Screw {
    /// All screws.
    pub const ALL: [Self; 13] = [
        Self::ScreenTiltX,
        Self::ScreenTiltY,
        Self::ScreenShiftX,
        Self::ScreenShiftY,
        Self::ScreenTurn,
        Self::ScreenFocus,
        Self::RelayShiftX,
        Self::RelayShiftY,
        Self::RelayTiltX,
        Self::RelayTiltY,
        Self::CameraPointingX,
        Self::CameraPointingY,
        Self::CameraRoll,
    ];

    /// Its name, as the virtual camera's feature has it.
    pub fn name(self) -> String {
        format!("{self:?}")
    }

    /// Its name from a text.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|screw| screw.name() == name)
    }

    /// `deg` or `mm`.
    pub fn unit(self) -> &'static str {
        match self {
            Self::ScreenShiftX
            | Self::ScreenShiftY
            | Self::ScreenFocus
            | Self::RelayShiftX
            | Self::RelayShiftY => "mm",
            _ => "deg",
        }
    }

    /// What a positive turn does.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::ScreenTiltX => "turns the screen: its +x side away from the lenses",
            Self::ScreenTiltY => "turns the screen: its +y side away from the lenses",
            Self::ScreenShiftX => "moves the screen along +x",
            Self::ScreenShiftY => "moves the screen along +y",
            Self::ScreenTurn => "turns the screen about the axis, from +x towards +y",
            Self::ScreenFocus => "moves the screen away from the lenses",
            Self::RelayShiftX => "moves the relay's lenses along +x",
            Self::RelayShiftY => "moves the relay's lenses along +y",
            Self::RelayTiltX => "turns the relay's lenses about +x, right-handed",
            Self::RelayTiltY => "turns the relay's lenses about +y, right-handed",
            Self::CameraPointingX => "points the camera towards +x",
            Self::CameraPointingY => "points the camera towards +y",
            Self::CameraRoll => "rolls the camera about its boresight",
        }
    }

    /// Whether it stands where the lenses were built in: most benches have no screw there.
    pub fn is_built_in(self) -> bool {
        matches!(self, Self::RelayShiftX | Self::RelayShiftY | Self::RelayTiltX | Self::RelayTiltY)
    }

    /// Most that it turns either way.
    pub fn range(self) -> f64 {
        match self {
            Self::CameraRoll => 180.0,
            _ if self.unit() == "mm" => 2.0,
            _ => 5.0,
        }
    }
}

/// How far each screw is turned, deg or mm, in the order of [`Screw::ALL`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Turns([f64; 13]);

impl Turns {
    /// From the values in the order of [`Screw::ALL`]; missing ones are 0.
    pub fn from_slice(values: &[f64]) -> Self {
        let mut turns = Self::default();
        turns.0.iter_mut().zip(values).for_each(|(turn, value)| *turn = *value);
        turns
    }

    /// The values in the order of [`Screw::ALL`].
    pub fn values(&self) -> &[f64] {
        &self.0
    }

    /// One screw's turn.
    pub fn get(&self, screw: Screw) -> f64 {
        self.0[screw as usize]
    }

    /// Sets one screw's turn.
    pub fn set(&mut self, screw: Screw, value: f64) {
        self.0[screw as usize] = value;
    }

    /// Both turned one after the other.
    pub fn and(&self, other: &Self) -> Self {
        let mut sum = *self;
        sum.0.iter_mut().zip(other.0).for_each(|(turn, more)| *turn += more);
        sum
    }

    /// Adds the turns to what is wrong with a bench.
    pub fn apply(&self, wrong: &mut Imperfections) {
        let rad = |screw: Screw| self.get(screw).to_radians();
        let screen = &mut wrong.screen;
        screen.tilt_rad[0] += rad(Screw::ScreenTiltX);
        screen.tilt_rad[1] += rad(Screw::ScreenTiltY);
        screen.shift_mm[0] += self.get(Screw::ScreenShiftX);
        screen.shift_mm[1] += self.get(Screw::ScreenShiftY);
        screen.turn_rad += rad(Screw::ScreenTurn);
        screen.focus_mm += self.get(Screw::ScreenFocus);
        let relay = &mut wrong.relay;
        relay.shift_mm[0] += self.get(Screw::RelayShiftX);
        relay.shift_mm[1] += self.get(Screw::RelayShiftY);
        relay.tilt_rad[0] += rad(Screw::RelayTiltX);
        relay.tilt_rad[1] += rad(Screw::RelayTiltY);
        wrong.pointing_rad[0] += rad(Screw::CameraPointingX);
        wrong.pointing_rad[1] += rad(Screw::CameraPointingY);
        wrong.camera_roll_rad += rad(Screw::CameraRoll);
    }
}
