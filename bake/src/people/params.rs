//! The parameters of a built-in character, as its TOML states them.

use serde::Deserialize;

/// One character's parameters.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Params {
    /// A human on two legs.
    Person(Box<Person>),
    /// A dog.
    Dog(Dog),
}

/// A human.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Person {
    /// Metres from sole to crown.
    pub height: f32,
    /// Triangles to reduce to.
    #[serde(default = "triangles")]
    pub triangles: u32,
    /// Shape of the body.
    #[serde(default)]
    pub body: Body,
    /// Skin, face and hair.
    pub head: Head,
    /// What they wear.
    pub clothes: Clothes,
    /// How they move.
    #[serde(default)]
    pub gait: Gait,
}

/// Shape of a body; the defaults are a lean man.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Body {
    /// 0: straight, broad shoulders; 1: narrow waist and shoulders, wide hips, bust.
    pub curves: f32,
    /// Thickness of trunk and limbs; 1 is lean.
    pub girth: f32,
    /// Breadth of the shoulders; 1 is average.
    pub shoulders: f32,
    /// 0 to 1.
    pub belly: f32,
    /// Size of the head; 1 is 7.6 heads to the height.
    pub head_size: f32,
}

impl Default for Body {
    fn default() -> Self {
        Self {
            curves: 0.0,
            girth: 1.0,
            shoulders: 1.0,
            belly: 0.0,
            head_size: 1.0,
        }
    }
}

/// Skin, face and hair.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Head {
    /// sRGB, `#rrggbb`, as are all colours.
    pub skin: Color,
    /// Colour of hair and brows.
    pub hair_color: Color,
    /// Cut.
    pub hair: Hair,
    /// Beard.
    #[serde(default)]
    pub beard: Beard,
    /// Worn on the head.
    #[serde(default)]
    pub hat: Hat,
    /// Colour of the hat.
    #[serde(default = "white")]
    pub hat_color: Color,
    /// Colour of the iris.
    #[serde(default = "brown")]
    pub eyes: Color,
}

/// Cut of the hair.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "described in assets/characters/README.md")]
pub enum Hair {
    Bald,
    Fringe,
    Short,
    SideParted,
    Bob,
    Long,
    Bun,
    Ponytail,
    Afro,
}

/// Beard.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "described in assets/characters/README.md")]
pub enum Beard {
    #[default]
    None,
    Moustache,
    Full,
}

/// Worn on the head.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "described in assets/characters/README.md")]
pub enum Hat {
    #[default]
    None,
    Cap,
    Helmet,
    Flat,
}

/// What they wear.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Clothes {
    /// Upper body.
    pub top: Top,
    /// Its colour.
    pub top_color: Color,
    /// What shows under an open top, such as the shirt under a suit; stripes and prints.
    #[serde(default = "white")]
    pub accent: Color,
    /// Tie or scarf.
    #[serde(default)]
    pub tie: Option<Color>,
    /// Lower body.
    pub bottom: Bottom,
    /// Its colour.
    pub bottom_color: Color,
    /// Colour of a belt, if they wear one.
    #[serde(default)]
    pub belt: Option<Color>,
    /// Feet.
    pub shoes: Shoes,
    /// Colour of the uppers.
    pub shoes_color: Color,
    /// Colour of the soles.
    #[serde(default = "black")]
    pub sole_color: Color,
}

/// Upper body.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "described in assets/characters/README.md")]
pub enum Top {
    Suit,
    Shirt,
    Tshirt,
    Tank,
    Hoodie,
    Vest,
    Dress,
    Coat,
    Blouse,
}

/// Lower body.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "described in assets/characters/README.md")]
pub enum Bottom {
    Trousers,
    Jeans,
    Leggings,
    Shorts,
    Skirt,
    Bare,
}

/// Feet.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "described in assets/characters/README.md")]
pub enum Shoes {
    Leather,
    Sneakers,
    Boots,
    Flats,
}

/// How a human moves.
#[derive(Debug, Clone, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Gait {
    /// Metres per second.
    pub walk_speed: f32,
    /// Metres per second.
    pub run_speed: f32,
    /// 1 is average.
    pub arm_swing: f32,
    /// Sway of the hips; 1 is average.
    pub sway: f32,
    /// Distance of a footprint from the middle line, as a share of the hip joint's.
    pub step_width: f32,
    /// Bend of the upper back, radians.
    pub stoop: f32,
}

impl Default for Gait {
    fn default() -> Self {
        Self {
            walk_speed: 1.35,
            run_speed: 3.2,
            arm_swing: 1.0,
            sway: 1.0,
            step_width: 0.75,
            stoop: 0.0,
        }
    }
}

/// A dog.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dog {
    /// Metres from the ground to the withers.
    pub height: f32,
    /// Triangles to reduce to.
    #[serde(default = "triangles")]
    pub triangles: u32,
    /// Coat.
    pub coat: Color,
    /// Muzzle, chest, belly and paws.
    pub markings: Color,
    /// Collar.
    pub collar: Color,
    /// Metres per second.
    pub walk_speed: f32,
    /// Metres per second.
    pub run_speed: f32,
}

/// sRGB, 8 bits a channel.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(try_from = "String")]
pub struct Color(pub [u8; 3]);

impl TryFrom<String> for Color {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let digits = text
            .strip_prefix('#')
            .filter(|d| d.len() == 6 && d.is_ascii());
        let parse = |d: &str| u32::from_str_radix(d, 16).ok();
        match digits.and_then(parse) {
            Some(v) => Ok(Self([(v >> 16) as u8, (v >> 8) as u8, v as u8])),
            None => Err(format!("'{text}' is not a colour such as \"#c08060\"")),
        }
    }
}

impl Color {
    /// Linear RGBA.
    pub fn linear(self) -> [f32; 4] {
        let [r, g, b] = self.0.map(|c| {
            let s = f32::from(c) / 255.0;
            if s <= 0.04045 {
                s / 12.92
            } else {
                ((s + 0.055) / 1.055).powf(2.4)
            }
        });
        [r, g, b, 1.0]
    }
}

fn triangles() -> u32 {
    5600
}

fn white() -> Color {
    Color([240; 3])
}

fn black() -> Color {
    Color([26; 3])
}

fn brown() -> Color {
    Color([70, 42, 22])
}

impl Params {
    /// Checks ranges.
    ///
    /// Errors: a sentence that names the parameter, its value and its range.
    pub fn check(&self) -> Result<(), String> {
        let gait = Gait::default();
        let ranges: Vec<(&str, f32, f32, f32)> = match self {
            Self::Person(p) => vec![
                ("height", p.height, 1.2, 2.2),
                ("triangles", p.triangles as f32, 2000.0, 30000.0),
                ("body.curves", p.body.curves, 0.0, 1.0),
                ("body.girth", p.body.girth, 0.85, 1.35),
                ("body.shoulders", p.body.shoulders, 0.85, 1.2),
                ("body.belly", p.body.belly, 0.0, 1.0),
                ("body.head_size", p.body.head_size, 0.9, 1.2),
                ("gait.walk_speed", p.gait.walk_speed, 0.4, 2.0),
                ("gait.run_speed", p.gait.run_speed, 1.8, 5.0),
                ("gait.arm_swing", p.gait.arm_swing, 0.0, 2.0),
                ("gait.sway", p.gait.sway, 0.0, 2.0),
                ("gait.step_width", p.gait.step_width, 0.3, 1.5),
                ("gait.stoop", p.gait.stoop, gait.stoop, 0.6),
            ],
            Self::Dog(d) => vec![
                ("height", d.height, 0.3, 0.9),
                ("triangles", d.triangles as f32, 2000.0, 30000.0),
                ("walk_speed", d.walk_speed, 0.4, 2.0),
                ("run_speed", d.run_speed, 1.5, 6.0),
            ],
        };
        for (name, value, low, high) in ranges {
            if !(low..=high).contains(&value) {
                return Err(format!("{name} is {value}; it can be {low} to {high}"));
            }
        }
        Ok(())
    }
}
