//! The device's description of itself: a GenICam file (schema 1.1).

use std::fmt::Write as _;

use crate::features::{Access, FIRST, Feature, KNOBS, Kind, Limit, STRIDE};
use crate::imager::{CameraInfo, Knob};
use crate::registers;

/// Texts among the bootstrap registers: name, address, bytes, access, meaning.
const TEXTS: [(&str, u32, usize, &str, &str); 5] = [
    ("DeviceVendorName", 0x0048, 32, "RO", "Who made the device"),
    ("DeviceModelName", 0x0068, 32, "RO", "The setup that the bench follows"),
    ("DeviceVersion", 0x0088, 32, "RO", "Version of the program"),
    ("DeviceSerialNumber", 0x00d8, 16, "RO", "Serial number"),
    (
        "DeviceUserID",
        registers::USER_NAME,
        registers::USER_NAME_BYTES,
        "RW",
        "The user's name for the device",
    ),
];

/// Numbers among them: name, address, bits from the highest (0) to the lowest (31), access, meaning.
const WORDS: [(&str, u32, [u32; 2], &str, &str); 9] = [
    (
        "GevHeartbeatTimeout",
        registers::HEARTBEAT_TIMEOUT_MS,
        [0, 31],
        "RW",
        "Silence after which the controller is gone, ms",
    ),
    ("GevTimestampTickFrequency", 0x0940, [0, 31], "RO", "Ticks of the time stamps in a second"),
    ("GevCCP", registers::PRIVILEGE, [0, 31], "RW", "Privilege of the controller"),
    ("GevStreamChannelCount", 0x0904, [0, 31], "RO", "Stream channels"),
    ("GevSCPHostPort", registers::STREAM_PORT, [16, 31], "RW", "Port to which images are sent"),
    ("GevSCPSFireTestPacket", registers::STREAM_PACKET, [0, 0], "RW", "Sends one packet of the present size"),
    ("GevSCPSPacketSize", registers::STREAM_PACKET, [16, 31], "RW", "Bytes of a packet with its headers"),
    ("GevSCPD", registers::STREAM_DELAY, [0, 31], "RW", "Least time between two packets, ticks"),
    ("GevSCDA", registers::STREAM_ADDRESS, [0, 31], "RW", "Address to which images are sent"),
];

/// The file's text.
pub(crate) fn description(info: &CameraInfo, features: &[Feature]) -> String {
    let mut nodes = String::new();
    let mut categories: Vec<(&str, Vec<String>)> = Vec::new();
    let mut list = |category: &'static str, name: String| match categories
        .iter_mut()
        .find(|(known, _)| *known == category)
    {
        Some((_, names)) => names.push(name),
        None => categories.push((category, vec![name])),
    };
    for (name, address, bytes, access, meaning) in TEXTS {
        list("DeviceControl", name.into());
        let _ = writeln!(
            nodes,
            "<StringReg Name=\"{name}\">{}<Address>{address:#x}</Address><Length>{bytes}</Length>\
             <AccessMode>{access}</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable></StringReg>",
            tip(meaning)
        );
    }
    for feature in features {
        list(feature.category, feature.name());
        node(&mut nodes, feature);
    }
    for (name, address, [first, last], access, meaning) in WORDS {
        list("TransportLayerControl", name.into());
        let most = (1u64 << (last - first + 1)) - 1;
        let [low, high] = match name {
            "GevSCPSPacketSize" => {
                [u64::from(*registers::PACKET_BYTES.start()), u64::from(*registers::PACKET_BYTES.end())]
            }
            _ => [0, most],
        };
        let _ = writeln!(
            nodes,
            "<Integer Name=\"{name}\">{}<pValue>{name}Reg</pValue><Min>{low}</Min><Max>{high}</Max></Integer>\n\
             <MaskedIntReg Name=\"{name}Reg\"><Address>{address:#x}</Address><Length>4</Length>\
             <AccessMode>{access}</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable>\
             <LSB>{last}</LSB><MSB>{first}</MSB><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></MaskedIntReg>",
            tip(meaning)
        );
    }
    for (place, knob) in info.knobs.iter().enumerate() {
        list("Bench", knob.name.clone());
        knob_node(&mut nodes, place, knob);
    }
    let mut head = String::from("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n");
    let _ = writeln!(
        head,
        "<RegisterDescription ModelName=\"{}\" VendorName=\"RETINA\" ToolTip=\"Virtual bench\" \
         StandardNameSpace=\"GEV\" SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" \
         MajorVersion=\"1\" MinorVersion=\"0\" SubMinorVersion=\"0\" \
         ProductGuid=\"7d1a4c5e-2f4b-4a2e-9c59-52455449004e\" VersionGuid=\"c0a1d6b2-94d3-4f8a-8a3e-52455449014e\" \
         xmlns=\"http://www.genicam.org/GenApi/Version_1_1\">",
        escaped(&info.model)
    );
    let names = |tag: &str, names: &mut dyn Iterator<Item = String>| {
        names.map(|name| format!("<{tag}>{name}</{tag}>")).collect::<String>()
    };
    let _ = writeln!(
        head,
        "<Category Name=\"Root\" NameSpace=\"Standard\">{}</Category>",
        names("pFeature", &mut categories.iter().map(|(name, _)| (*name).to_owned()))
    );
    for (category, features) in &categories {
        let _ = writeln!(
            head,
            "<Category Name=\"{category}\" NameSpace=\"Standard\">{}</Category>",
            names("pFeature", &mut features.iter().cloned())
        );
    }
    head + &nodes + "<Port Name=\"Device\" NameSpace=\"Standard\"></Port>\n</RegisterDescription>\n"
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

fn tip(meaning: &str) -> String {
    format!("<ToolTip>{}</ToolTip>", escaped(meaning))
}

fn unit_of(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!("<Unit>{}</Unit>", escaped(unit)) }
}

/// A feature and its register.
fn node(nodes: &mut String, feature: &Feature) {
    let (name, address) = (feature.name(), FIRST + STRIDE * feature.id as u32);
    let register = format!("<pValue>{name}Reg</pValue>");
    let access = match (feature.kind, feature.access) {
        (Kind::Command, _) => "WO",
        (_, Access::Read) => "RO",
        _ => "RW",
    };
    let head = tip(feature.meaning)
        + if feature.access == Access::WriteAtRest { "<pIsLocked>TLParamsLocked</pIsLocked>" } else { "" };
    let (kind, bytes) = match feature.kind {
        Kind::Integer { min, max, unit } => {
            let max = match max {
                Limit::Is(max) => format!("<Max>{max}</Max>"),
                Limit::Of(id) => format!("<pMax>{id:?}</pMax>"),
            };
            (
                format!(
                    "<Integer Name=\"{name}\">{head}{register}<Min>{min}</Min>{max}{}</Integer>",
                    unit_of(unit)
                ),
                4,
            )
        }
        Kind::Float { min, max, unit } => {
            let limits = format!("<Min>{min}</Min><Max>{max}</Max>{}", unit_of(unit));
            (format!("<Float Name=\"{name}\">{head}{register}{limits}</Float>"), 8)
        }
        Kind::Choice(choices) => {
            let entries: String = choices
                .iter()
                .map(|(choice, code)| {
                    format!("<EnumEntry Name=\"{choice}\"><Value>{code}</Value></EnumEntry>")
                })
                .collect();
            (format!("<Enumeration Name=\"{name}\">{head}{entries}{register}</Enumeration>"), 4)
        }
        Kind::Switch => {
            let values = "<OnValue>1</OnValue><OffValue>0</OffValue>";
            (format!("<Boolean Name=\"{name}\">{head}{register}{values}</Boolean>"), 4)
        }
        Kind::Command => {
            (format!("<Command Name=\"{name}\">{head}{register}<CommandValue>1</CommandValue></Command>"), 4)
        }
    };
    let _ = writeln!(nodes, "{kind}");
    register_node(nodes, &name, address, bytes, access);
}

fn knob_node(nodes: &mut String, place: usize, knob: &Knob) {
    let (name, [min, max]) = (&knob.name, knob.range);
    let _ = writeln!(
        nodes,
        "<Float Name=\"{name}\">{}<pValue>{name}Reg</pValue><Min>{min}</Min><Max>{max}</Max>{}</Float>",
        tip(&knob.meaning),
        unit_of(&knob.unit)
    );
    register_node(nodes, name, KNOBS + STRIDE * place as u32, 8, "RW");
}

fn register_node(nodes: &mut String, name: &str, address: u32, bytes: usize, access: &str) {
    let body = format!(
        "<Address>{address:#x}</Address><Length>{bytes}</Length><AccessMode>{access}</AccessMode>\
         <pPort>Device</pPort><Cachable>NoCache</Cachable>"
    );
    let _ = match bytes {
        8 => {
            writeln!(nodes, "<FloatReg Name=\"{name}Reg\">{body}<Endianess>BigEndian</Endianess></FloatReg>")
        }
        _ => writeln!(
            nodes,
            "<IntReg Name=\"{name}Reg\">{body}<Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
        ),
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::{table, test_info};

    #[test]
    fn every_name_that_is_referred_to_is_there_once() {
        let info = test_info();
        let text = description(&info, &table(&info));
        let defined: Vec<&str> =
            text.split(" Name=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
        for tag in ["pFeature", "pValue", "pMax", "pPort", "pIsLocked"] {
            for part in text.split(&format!("<{tag}>")).skip(1) {
                let name = part.split('<').next().unwrap();
                let count = defined.iter().filter(|&&known| known == name).count();
                assert_eq!(count, 1, "{name} of {tag}");
            }
        }
        for name in ["Width", "ExposureTime", "TriggerSoftware", "DeviceTemperature", "Focus"] {
            assert!(defined.contains(&name), "{name}");
        }
    }
}
