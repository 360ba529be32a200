//! The catalogued effects by id. An id never changes its meaning.
//!
//! Whoever treats effects (the workbench's catalogue, the bench's campaigns, the images) matches these exhaustively:
//! an effect that is added here and nowhere else does not compile.

use crate::TableKind;

/// One enum a table: variants, their ids, and the list of all.
macro_rules! effects {
    ($(#[$doc:meta])* $name:ident { $($(#[$text:meta])* $variant:ident = $id:literal),* $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum $name { $($(#[$text])* $variant),* }

        impl $name {
            /// All of them, in the catalogue's order.
            pub const ALL: &'static [Self] = &[$(Self::$variant),*];

            /// Its id.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $id),* }
            }
        }
    };
}

effects! {
    /// Effects on the places of points, `points.csv`.
    PointsEffect {
        /// The display is tilted.
        ScreenTilt = "screen_tilt",
        /// The camera looks aside.
        CameraPointing = "camera_pointing",
        /// A lens is decentred.
        Decentering = "decentering",
        /// The distortion has another centre.
        OpticalCentre = "optical_centre",
        /// A wedge in the collimated beam.
        ThinPrism = "thin_prism",
        /// Radial distortion beyond k1.
        RadialHigherOrder = "radial_higher_order",
        /// The display is bent.
        ScreenBow = "screen_bow",
        /// Coma: the centroid of a brighter point walks outwards.
        FluxComa = "flux_coma",
        /// Coma of a misaligned lens: the centroid moves with the light.
        FluxShift = "flux_shift",
        /// A sloping background pulls faint centroids.
        BackgroundGradient = "background_gradient",
        /// The scale depends on the channel.
        LateralColour = "lateral_colour",
        /// A wedge shifts the channels apart.
        ColourWedge = "colour_wedge",
        /// The sub-pixels stand side by side.
        SubpixelOffset = "subpixel_offset",
        /// The boresight follows the temperature.
        ThermalBoresight = "thermal_boresight",
        /// The focal length follows the temperature.
        ThermalFocal = "thermal_focal",
        /// The boresight moves with time.
        Drift = "drift",
        /// The roll changes with time.
        RollDrift = "roll_drift",
        /// The boresight jumps once.
        Knock = "knock",
        /// The centroid depends on its place in the camera's pixel.
        CameraPixelPhase = "camera_pixel_phase",
        /// The centroid depends on the point's place in the screen's pixel.
        ScreenPixelPhase = "screen_pixel_phase",
        /// A lit row shifts its points.
        RowLoadingShift = "row_loading_shift",
    }
}

effects! {
    /// Effects on readings of a power meter, `power.csv`.
    PowerEffect {
        /// The response's exponent differs.
        Gamma = "gamma",
        /// Black pixels shine.
        BlackLevel = "black_level",
        /// A large lit area loses light.
        SquareLoading = "square_loading",
        /// Lit neighbours lend light.
        PixelCrosstalk = "pixel_crosstalk",
        /// The light changes as the display warms up.
        SelfHeating = "self_heating",
        /// The light falls with the dose.
        Ageing = "ageing",
        /// The meter has an offset.
        MeterZero = "meter_zero",
        /// The meter's responsivity is off by channel.
        MeterWavelength = "meter_wavelength",
        /// The meter is not linear.
        MeterNonlinearity = "meter_nonlinearity",
        /// White is not the sum of its channels.
        ChannelNonadditivity = "channel_nonadditivity",
        /// One series carries a constant factor.
        AttenuatorNotChanged = "attenuator_not_changed",
    }
}

effects! {
    /// Effects on a body's phase curve, `phase.csv`.
    PhaseEffect {
        /// Lommel-Seeliger's law in Lambert's place.
        LommelSeeliger = "lommel_seeliger",
        /// The particles have a phase function.
        PhaseFunction = "phase_function",
        /// The body is brighter near full.
        OppositionSurge = "opposition_surge",
        /// The surface is rough.
        Roughness = "roughness",
        /// Before and after full differ.
        WaxingWaning = "waxing_waning",
        /// The atmosphere takes light.
        Extinction = "extinction",
    }
}

effects! {
    /// Effects on images, `frames.csv`.
    FramesEffect {
        /// Another photometric law.
        PhotometricFunction = "photometric_function",
        /// The albedo varies over the body.
        AlbedoMap = "albedo_map",
        /// The body has relief.
        Relief = "relief",
        /// Relief casts shadows.
        TerrainShadow = "terrain_shadow",
        /// The image is blurred.
        Defocus = "defocus",
        /// The blur grows with the field.
        FieldCurvature = "field_curvature",
        /// Spots have tails along the radius.
        Coma = "coma",
        /// Spots are wider along the radius than across.
        Astigmatism = "astigmatism",
        /// Light is spread widely.
        VeilingGlare = "veiling_glare",
        /// A mirrored image.
        Ghost = "ghost",
        /// Light falls with the field.
        Vignetting = "vignetting",
        /// A level without light.
        DarkOffset = "dark_offset",
        /// The detector is not linear.
        DetectorNonlinearity = "detector_nonlinearity",
        /// Bright pixels are cut.
        Saturation = "saturation",
        /// The camera's pixels differ.
        Prnu = "prnu",
        /// The screen's pixels differ.
        Mura = "mura",
        /// The image is shifted.
        ImageShift = "image_shift",
        /// The image is turned.
        Roll = "roll",
        /// The image is scaled.
        Scale = "scale",
        /// A point has a width.
        SourceSize = "source_size",
    }
}

/// An effect of any table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum EffectId {
    /// On points.
    Points(PointsEffect),
    /// On power readings.
    Power(PowerEffect),
    /// On phase curves.
    Phase(PhaseEffect),
    /// On images.
    Frames(FramesEffect),
}

/// Sets that one ordinary campaign cannot tell apart.
const CLASSES: &[&[EffectId]] = &[
    &[
        EffectId::Points(PointsEffect::ScreenTilt),
        EffectId::Points(PointsEffect::CameraPointing),
        EffectId::Points(PointsEffect::Decentering),
        EffectId::Points(PointsEffect::OpticalCentre),
        EffectId::Points(PointsEffect::ThinPrism),
    ],
    &[EffectId::Points(PointsEffect::BackgroundGradient), EffectId::Points(PointsEffect::FluxShift)],
    &[EffectId::Points(PointsEffect::ColourWedge), EffectId::Points(PointsEffect::SubpixelOffset)],
    &[EffectId::Points(PointsEffect::Drift), EffectId::Points(PointsEffect::ThermalBoresight)],
    &[EffectId::Frames(FramesEffect::Relief), EffectId::Frames(FramesEffect::TerrainShadow)],
    &[EffectId::Frames(FramesEffect::Defocus), EffectId::Frames(FramesEffect::FieldCurvature)],
    &[EffectId::Frames(FramesEffect::Mura), EffectId::Frames(FramesEffect::Prnu)],
];

impl EffectId {
    /// All effects, table by table.
    pub fn all() -> impl Iterator<Item = Self> {
        let points = PointsEffect::ALL.iter().map(|&effect| Self::Points(effect));
        let power = PowerEffect::ALL.iter().map(|&effect| Self::Power(effect));
        let phase = PhaseEffect::ALL.iter().map(|&effect| Self::Phase(effect));
        let frames = FramesEffect::ALL.iter().map(|&effect| Self::Frames(effect));
        points.chain(power).chain(phase).chain(frames)
    }

    /// Its id, as files and flags have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Points(effect) => effect.name(),
            Self::Power(effect) => effect.name(),
            Self::Phase(effect) => effect.name(),
            Self::Frames(effect) => effect.name(),
        }
    }

    /// From its id.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::all().find(|effect| effect.name() == name)
    }

    /// The table in which it shows.
    pub fn table(self) -> TableKind {
        match self {
            Self::Points(_) => TableKind::Points,
            Self::Power(_) => TableKind::Power,
            Self::Phase(_) => TableKind::Phase,
            Self::Frames(_) => TableKind::Frames,
        }
    }

    /// Unit of what it adds to a row.
    pub fn unit(self) -> &'static str {
        self.table().unit()
    }

    /// The effects that one ordinary campaign cannot tell from it, itself included.
    pub fn class(self) -> Vec<Self> {
        CLASSES.iter().find(|class| class.contains(&self)).map_or_else(|| vec![self], |class| class.to_vec())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_given_once_and_found_again() {
        let all: Vec<EffectId> = EffectId::all().collect();
        for (at, effect) in all.iter().enumerate() {
            assert_eq!(EffectId::from_name(effect.name()), Some(*effect));
            assert!(all[..at].iter().all(|other| other.name() != effect.name()), "{}", effect.name());
            assert!(effect.class().contains(effect));
            assert!(effect.class().iter().all(|member| member.table() == effect.table()));
        }
        assert_eq!(EffectId::from_name("screen_tlt"), None);
    }
}
