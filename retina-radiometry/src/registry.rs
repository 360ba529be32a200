//! How laws and phase functions are registered: the traits that each one implements, its keys in a scene, and the
//! macro that makes an enum of a list of them.

/// Numbers that a law has in the shader.
pub const LAW_PARAMETERS: usize = 12;
/// Numbers that a phase function has in the shader.
pub const PHASE_PARAMETERS: usize = 4;

/// A key of a law or a phase function in a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    /// Its name, with the unit.
    pub name: &'static str,
    /// What it is, in words, for errors.
    pub meaning: &'static str,
    /// How many numbers it has: 1 is a number, more are a list.
    pub length: usize,
    /// Least and largest value that is allowed.
    pub range: [f64; 2],
    /// What counts where the key is missing.
    pub default: KeyDefault,
}

/// What counts where a key is missing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum KeyDefault {
    /// The key must be there.
    Required,
    /// This value.
    Value(f64),
    /// The value with which I/F at incidence = emission = phase = 0 is the normal albedo. It is sought within the
    /// key's range, over which I/F grows. If the key is given, the normal albedo may be left out.
    FromNormalAlbedo,
}

impl Key {
    /// A key that must be there.
    pub const fn required(name: &'static str, meaning: &'static str, range: [f64; 2]) -> Self {
        Self { name, meaning, length: 1, range, default: KeyDefault::Required }
    }

    /// A key that may be left out.
    pub const fn or(name: &'static str, meaning: &'static str, range: [f64; 2], default: f64) -> Self {
        Self { name, meaning, length: 1, range, default: KeyDefault::Value(default) }
    }

    /// A key that follows from the normal albedo where it is left out.
    pub const fn from_normal_albedo(name: &'static str, meaning: &'static str, range: [f64; 2]) -> Self {
        Self { name, meaning, length: 1, range, default: KeyDefault::FromNormalAlbedo }
    }

    /// A list of finite numbers that must be there.
    pub const fn list(name: &'static str, meaning: &'static str, length: usize) -> Self {
        Self { name, meaning, length, range: [f64::MIN, f64::MAX], default: KeyDefault::Required }
    }
}

/// What a law and a phase function have alike.
pub trait Definition: Copy {
    /// Its keys in a scene.
    const KEYS: &'static [Key];

    /// From the numbers of [`Definition::KEYS`], in their order, lists in a row. There must be as many.
    fn from_values(values: &[f64]) -> Self;
}

/// An entry of a register, as the scene's reader and the shaders need it.
#[derive(Debug)]
pub struct Kind<T: 'static> {
    /// Its name in a scene.
    pub name: &'static str,
    /// Its keys in a scene.
    pub keys: &'static [Key],
    /// The WGSL source.
    pub wgsl: &'static str,
    /// The name of the WGSL function.
    pub function: &'static str,
    /// From the numbers of its keys, in their order, lists in a row. There must be as many.
    pub from_values: fn(&[f64]) -> T,
}

impl<T> Kind<T> {
    /// How many numbers all its keys have.
    pub fn value_count(&self) -> usize {
        self.keys.iter().map(|key| key.length).sum()
    }
}

/// An enum that is made of a register.
pub trait Registered: Sized + 'static {
    /// Every kind. Its index here is its number in the shader.
    const ALL: &'static [Kind<Self>];
}

/// These numbers as f32, and zeros after them.
pub(crate) fn padded<const N: usize, const M: usize>(values: [f64; N]) -> [f32; M] {
    const { assert!(N <= M, "more parameters than the shader has room for") };
    let mut out = [0.0; M];
    for (to, from) in out.iter_mut().zip(values) {
        *to = from as f32;
    }
    out
}

/// Makes an enum with a variant for each type in a list, and what goes by that list. Each line is the name in a scene,
/// the module and the type. The WGSL source stands beside the module and has a function `PREFIX_MODULE`.
macro_rules! register {
    (
        $(#[$doc:meta])*
        $list:ident, functions $prefix:literal {
            $($(#[$variant_doc:meta])* $name:literal => $module:ident::$variant:ident,)+
        }
    ) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub enum $list {
            $($(#[$variant_doc])* $variant($module::$variant),)+
        }

        impl $crate::Registered for $list {
            const ALL: &'static [$crate::Kind<Self>] = &[$($crate::Kind {
                name: $name,
                keys: <$module::$variant as $crate::Definition>::KEYS,
                wgsl: include_str!(concat!(stringify!($module), ".wgsl")),
                function: concat!($prefix, "_", stringify!($module)),
                from_values: |values| Self::$variant($crate::Definition::from_values(values)),
            },)+];
        }

        impl $list {
            /// Its index in [`Registered::ALL`](crate::Registered::ALL), which is its number in the shader.
            pub fn index(&self) -> u32 {
                enum Index { $($variant,)+ }
                match self {
                    $(Self::$variant(_) => Index::$variant as u32,)+
                }
            }

            /// Its entry in the register.
            pub fn kind(&self) -> &'static $crate::Kind<Self> {
                &<Self as $crate::Registered>::ALL[self.index() as usize]
            }

            /// Its name in a scene.
            pub fn name(&self) -> &'static str {
                self.kind().name
            }
        }

        $(impl From<$module::$variant> for $list {
            fn from(value: $module::$variant) -> Self {
                Self::$variant(value)
            }
        })+

        /// Does the same with whichever it is.
        macro_rules! each {
            ($value:expr, $inner:ident => $does:expr) => {
                match $value {
                    $($list::$variant($inner) => $does,)+
                }
            };
        }
    };
}
pub(crate) use register;
