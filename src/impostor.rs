//! impostor: the quads of all agents that show an impostor kind, in a few indirect draws for all characters. Host side of
//! hlsl/impostor.hlsl; twin in [`crate::reference::impostor`].

use std::ops::Range;

use ash::vk;
use throng_bake::baked::PaletteEntry;
use throng_bake::impostor::{Atlas, CUBE_TEXELS, Impostors, Kind, NO_JOINT, Quad, Tile};

use crate::gpu::{Commands, Drawing, Recorded};
use crate::gpu_types::{
    BandInfo, DrawCommand, FLAT_BIN, IMPOSTOR_DRAWS, PACKED_COMMANDS, QUAD_BIN, SLICE_COUNT,
};
use crate::pool::Pool;

/// Records the draws of all impostors that may have agents.
pub(crate) fn record(c: &mut Commands, drawing: &Drawing, recorded: &Recorded) {
    const GRAPHICS: vk::PipelineBindPoint = vk::PipelineBindPoint::GRAPHICS;
    let (slot, pipelines) = (drawing.slot, drawing.pipelines);
    let (Some(buffers), Some(gallery)) = (&slot.buffers, drawing.gallery) else {
        return;
    };
    let layout = pipelines.draw_layout;
    let mut bound = false;
    // They stand behind the draws of the lists and that of the shadows.
    let first = recorded.bands.len() as u32 + 1;
    for (place, (look, bins)) in (first..)
        .step_by(PACKED_COMMANDS as usize)
        .zip(draws(recorded.plain_slices))
    {
        let kind = look.kind_bin();
        let shown = (0..drawing.residents.len()).any(|character| slot.may_draw(character, kind));
        if bins.is_empty() || !shown {
            continue;
        }
        c.bind_pipeline(GRAPHICS, pipelines.impostor(look));
        if !std::mem::replace(&mut bound, true) {
            c.bind_instances(&buffers.instances);
            c.bind_set(GRAPHICS, layout, 0, slot.draw_set);
            c.bind_set(GRAPHICS, layout, 2, gallery.set);
            c.bind_indices(&gallery.indices, vk::IndexType::UINT32);
        }
        c.draw_indexed_indirect(&buffers.draws, place, PACKED_COMMANDS);
    }
}

/// How quads are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// One for an agent, too small for its relief to show.
    Plain,
    /// One for an agent, whose pixels shift by their depth.
    Soft,
    /// One for each group of joints.
    Flat,
}

impl Look {
    /// First bin of the kind.
    pub fn kind_bin(self) -> u32 {
        match self {
            Self::Plain | Self::Soft => QUAD_BIN,
            Self::Flat => FLAT_BIN,
        }
    }
}

/// A frame's draws of impostors in their order, from far to near, with the bins that each shows.
pub fn draws(plain_slices: u32) -> [(Look, Range<u32>); IMPOSTOR_DRAWS as usize] {
    let plain_end = QUAD_BIN + plain_slices;
    [
        (Look::Plain, QUAD_BIN..plain_end),
        (Look::Soft, plain_end..QUAD_BIN + SLICE_COUNT),
        (Look::Flat, FLAT_BIN..FLAT_BIN + SLICE_COUNT),
    ]
}

/// The impostors of all characters as the device reads them: a table, cube maps of view cells, and all atlases on a grid of
/// squares in one picture. What a character had is free for others once it is removed; nobody else's moves. The grid's coarser mips
/// stand below it, side by side: pixels look up the one that their quad's corners chose, and lavapipe samples a picture without
/// mips in less time. It is no array of pictures either, which cost more to sample, too.
///
/// The table is an array of records, here called texels. Texel 0 is the grid's width and height, the side of a square and the number of columns.
/// Behind it, for each character:
/// - a texel for each pose, at least one: the texels of `quad`'s one and of its first view's tile; the texel of the first quad of
///   `flat`, and how many there are,
/// - three for each quad: centre and depth extent; joint (-1: none), texel of its first tile, texel of its first view, texel of
///   the palette; cube map, atlas, last mip,
/// - two for each view of all view sets: direction; the picture's right,
/// - three for each tile: `min` and `max` in its plane; its left, bottom, right and top texel in the atlas; lean,
/// - where quads follow joints, the palette: three for each joint in each frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Gallery {
    /// The table; texel 0 is written when it is uploaded.
    pub texels: Pool<[f32; 4]>,
    /// Three views and a zero, `[view set][CUBE_TEXELS]`.
    pub cells: Pool<[u16; 4]>,
    /// Side of a square in texels: the longest of any atlas.
    pub side: u32,
    /// Mips of the grid: the most of any atlas.
    pub mip_count: u32,
    /// Squares that have atlases, and those between them.
    pub atlas_count: u32,
    /// The most quads of any kind.
    pub quad_count: u32,
    /// The picture is of BC7 blocks. The first atlas decides.
    pub blocks: bool,
    /// What stands in each square.
    squares: Vec<Option<Square>>,
}

/// What an atlas asks of the whole gallery.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Square {
    side: u32,
    mip_count: u32,
    /// The most quads of any kind.
    quad_count: u32,
}

/// Where a character's impostors stand in the gallery.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Block {
    /// Texel of its first pose.
    pub first_pose: u32,
    /// The square of its atlas.
    pub square: u32,
    texels: Range<usize>,
    cells: Range<usize>,
}

impl Gallery {
    /// View sets.
    pub fn view_set_count(&self) -> u32 {
        (self.cells.len() / CUBE_TEXELS) as u32
    }

    /// Texels that a character's block takes, whose palette has so many entries.
    pub fn block_size(impostors: &Impostors, palette_len: usize) -> u64 {
        let poses = u64::from(pose_texels(impostors));
        let views: usize = impostors.view_sets.iter().map(|s| s.directions.len()).sum();
        let palette_len = match impostors.kinds.iter().any(|k| k.kind == Kind::Flat) {
            true => palette_len,
            false => 0,
        };
        poses
            + 2 * views as u64
            + 3 * (impostors.quads.len() + impostors.tiles.len() + palette_len) as u64
    }

    /// The side of a square where one more atlas has to fit.
    pub fn side_with(&self, atlas: &Atlas) -> u32 {
        let mip_count = self.mip_count.max(atlas.mip_count);
        let side = self.side.max(atlas.width).max(atlas.height);
        Self::rounded_side(side, mip_count)
    }

    /// Columns and rows of the grid for a number of atlases: no more rows than columns.
    pub fn grid(atlas_count: u32) -> [u32; 2] {
        let columns = f64::from(atlas_count).sqrt().ceil().max(1.0) as u32;
        [columns, atlas_count.div_ceil(columns).max(1)]
    }

    /// Columns and rows of the picture that has a grid of so many squares and its coarser mips.
    pub fn picture_size(atlas_count: u32, side: u32) -> [u64; 2] {
        let [width, height] = Self::grid(atlas_count).map(|n| u64::from(n) * u64::from(side));
        [width, height / 2 * 3]
    }

    /// Texel of the table where a character's block would begin.
    pub fn block_place(&self, block_size: u64) -> u64 {
        // Texel 0 is nobody's.
        self.texels.place(block_size as usize).max(1) as u64
    }

    /// The square where one more atlas would stand.
    pub fn next_square(&self) -> u32 {
        let free = self.squares.iter().position(Option::is_none);
        free.unwrap_or(self.squares.len()) as u32
    }

    /// Whether an atlas stands in a square.
    pub fn has_atlas(&self, square: u32) -> bool {
        matches!(self.squares.get(square as usize), Some(Some(_)))
    }

    /// Takes in the impostors of a validated character, whose palette they follow.
    pub fn insert(&mut self, impostors: &Impostors, palette: &[PaletteEntry]) -> Block {
        if self.texels.is_empty() {
            self.texels = Pool::from(vec![[0.0; 4]]);
        }
        let size = Self::block_size(impostors, palette.len());
        let square = self.next_square();
        let cell_count = impostors.view_sets.iter().map(|s| s.cells.len()).sum();
        let first_cube = (self.cells.place(cell_count) / CUBE_TEXELS) as u32;
        let mut texels = Vec::with_capacity(size as usize);
        let pose_count = pose_texels(impostors);
        let first_pose = self.block_place(size) as u32;
        let first_quad = first_pose + pose_count;
        let mut first_view = first_quad + 3 * impostors.quads.len() as u32;
        let mut first_views = Vec::with_capacity(impostors.view_sets.len());
        for set in &impostors.view_sets {
            first_views.push(first_view);
            first_view += 2 * set.directions.len() as u32;
        }
        let first_tile = first_view;
        let tile = |t: u32| (first_tile + 3 * t) as f32;

        let find = |kind| impostors.kinds.iter().find(|k| k.kind == kind);
        let quad_texel = |quad: u32| (first_quad + 3 * quad) as f32;
        let (whole, flat) = (find(Kind::Quad), find(Kind::Flat));
        let [flat_texel, flat_count] = flat.map_or([0.0; 2], |k| {
            [quad_texel(k.first_quad), k.quad_count as f32]
        });
        for pose in 0..pose_count {
            let [quad, tile] = whole.map_or([0.0; 2], |kind| {
                let q = &impostors.quads[kind.first_quad as usize];
                let views = impostors.view_sets[q.view_set as usize].directions.len() as u32;
                [
                    quad_texel(kind.first_quad),
                    tile(q.first_tile + pose * views),
                ]
            });
            texels.push([quad, tile, flat_texel, flat_count]);
        }
        let palette_texel = first_tile + 3 * impostors.tiles.len() as u32;
        let last_mip = impostors.atlas.mip_count.saturating_sub(1) as f32;
        for q in &impostors.quads {
            let set = q.view_set as usize;
            let cube = first_cube + q.view_set;
            texels.push(q.center.extend(q.depth_extent).to_array());
            texels.push([
                joint_texel(q),
                tile(q.first_tile),
                first_views[set] as f32,
                palette_texel as f32,
            ]);
            texels.push([cube as f32, square as f32, last_mip, 0.0]);
        }
        for set in &impostors.view_sets {
            for (direction, right) in set.directions.iter().zip(&set.rights) {
                texels.push(direction.extend(0.0).to_array());
                texels.push(right.extend(0.0).to_array());
            }
        }
        for t in &trimmed_tiles(impostors) {
            let ([u, v], [width, height]) = (t.texel, t.size);
            texels.push([t.min[0], t.min[1], t.max[0], t.max[1]]);
            // Rows run from the left edge on, columns from the top edge down.
            texels.push([u + width, v, u, v + height]);
            let [x, y, z] = t.lean;
            texels.push([x, y, z, 0.0]);
        }
        if flat.is_some() {
            texels.extend(palette.iter().flat_map(|e| e.rows));
        }
        let cells = impostors.view_sets.iter().flat_map(|s| &s.cells).copied();
        let atlas = &impostors.atlas;
        if square as usize == self.squares.len() {
            self.squares.push(None);
        }
        self.squares[square as usize] = Some(Square {
            side: atlas.width.max(atlas.height),
            mip_count: atlas.mip_count,
            quad_count: impostors.kinds.iter().fold(0, |n, k| n.max(k.quad_count)),
        });
        self.measure();
        assert_eq!(texels.len() as u64, size, "as block_size says");
        Block {
            first_pose,
            square,
            texels: self.texels.insert(texels),
            cells: self.cells.insert(cells.collect()),
        }
    }

    /// Frees what [`Self::insert`] took. A gallery on the device shows the others as before until it is made anew.
    pub fn remove(&mut self, block: Block) {
        self.texels.remove(block.texels);
        self.cells.remove(block.cells);
        self.squares[block.square as usize] = None;
        while self.squares.pop_if(|s| s.is_none()).is_some() {}
        self.measure();
    }

    /// Makes the sizes those of the atlases that are there.
    fn measure(&mut self) {
        self.atlas_count = self.squares.len() as u32;
        let all = || self.squares.iter().flatten();
        self.mip_count = all().map(|s| s.mip_count).max().unwrap_or(0);
        self.quad_count = all().map(|s| s.quad_count).max().unwrap_or(0);
        let side = all().map(|s| s.side).max().unwrap_or(0);
        self.side = Self::rounded_side(side, self.mip_count);
    }

    /// A square's side at least so long, of which every mip begins and ends with a block of 4x4 texels.
    fn rounded_side(side: u32, mip_count: u32) -> u32 {
        side.next_multiple_of(4 << mip_count.saturating_sub(1))
    }
}

/// Texels of a character's poses: one where `flat` is its only kind.
pub fn pose_texels(impostors: &Impostors) -> u32 {
    let poses = impostors.clip_poses.iter().map(|r| r.pose_count);
    poses.sum::<u32>().max(1)
}

/// What is drawn of a tile: without the texels around its picture that show nothing, but for half of one on each side. A pixel
/// there is filtered from the last texel that shows something. Pixels that show nothing cost as much as others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shown {
    /// As [`Tile::min`].
    pub min: [f32; 2],
    /// As [`Tile::max`].
    pub max: [f32; 2],
    /// As [`Tile::texel`].
    pub texel: [f32; 2],
    /// As [`Tile::size`].
    pub size: [f32; 2],
    /// As [`Tile::lean`].
    pub lean: [f32; 3],
}

/// What is drawn of all tiles.
pub fn trimmed_tiles(impostors: &Impostors) -> Vec<Shown> {
    let tiles = impostors.tiles.iter();
    tiles.map(|tile| trimmed(&impostors.atlas, tile)).collect()
}

/// Outline below which a texel shows nothing: that of a coverage of `SOFT_EDGE` of hlsl/impostor.hlsl at a pixel for each texel.
const SOFT_EDGE_OUTLINE: u8 = 89;

/// [`trimmed_tiles`] of one tile.
pub(crate) fn trimmed(atlas: &Atlas, tile: &Tile) -> Shown {
    let [columns, rows] = tile.size.map(u32::from);
    let (mut first, mut last) = ([columns, rows], [0, 0]);
    for y in 0..rows {
        for x in 0..columns {
            let column = u32::from(tile.texel[0]) + x;
            let row = u32::from(tile.texel[1]) + y;
            if atlas.color[(row * atlas.width + column) as usize][3] >= SOFT_EDGE_OUTLINE {
                first = [first[0].min(x), first[1].min(y)];
                last = [last[0].max(x + 1), last[1].max(y + 1)];
            }
        }
    }
    let whole = [columns as f32, rows as f32];
    let is_empty = first[0] >= last[0];
    let (first, last) = match is_empty {
        true => ([0.0; 2], whole),
        false => (
            first.map(|x| (x as f32 - 0.5).max(0.0)),
            [0, 1].map(|k| (last[k] as f32 + 0.5).min(whole[k])),
        ),
    };
    let texel = [
        (tile.max[0] - tile.min[0]) / whole[1].max(1.0),
        (tile.max[1] - tile.min[1]) / whole[0].max(1.0),
    ];
    Shown {
        min: [
            tile.min[0] + first[1] * texel[0],
            tile.max[1] - last[0] * texel[1],
        ],
        max: [
            tile.min[0] + last[1] * texel[0],
            tile.max[1] - first[0] * texel[1],
        ],
        texel: [0, 1].map(|k| f32::from(tile.texel[k]) + first[k]),
        size: [0, 1].map(|k| last[k] - first[k]),
        lean: tile.lean,
    }
}

fn joint_texel(quad: &Quad) -> f32 {
    match quad.joint {
        NO_JOINT => -1.0,
        joint => joint as f32,
    }
}

/// Two triangles for every quad, `[6 * quad_count]`.
pub fn indices(quad_count: u32) -> Vec<u32> {
    (0..quad_count)
        .flat_map(|q| [0, 1, 2, 2, 1, 3].map(|corner| 4 * q + corner))
        .collect()
}

/// The instances of some slices of a kind as one draw, of `draws` of all lists. The device makes its draws of the same instances.
pub fn draw_of(draws: &[DrawCommand], bins: Range<u32>) -> DrawCommand {
    let slices = draws.get(bins.start as usize..bins.end as usize);
    let (first, last) = slices.and_then(|s| s.first().zip(s.last())).unzip();
    let none: DrawCommand = bytemuck::Zeroable::zeroed();
    let (first, last) = (*first.unwrap_or(&none), last.unwrap_or(&none));
    DrawCommand {
        instance_count: last.first_instance + last.instance_count - first.first_instance,
        ..first
    }
}

/// The index windows of the bins of all kinds, which are the first, where nobody has quads that follow joints.
pub fn windows() -> Vec<BandInfo> {
    [1, 0]
        .map(|quads| [window(quads); SLICE_COUNT as usize])
        .concat()
}

/// Sets those of agents that are a quad for each group of joints, where nobody has more than `quad_count` of them.
pub fn set_windows(windows: &mut [BandInfo], quad_count: u32) {
    windows[FLAT_BIN as usize..][..SLICE_COUNT as usize].fill(window(quad_count));
}

fn window(quad_count: u32) -> BandInfo {
    BandInfo {
        first_index: 0,
        index_count: 6 * quad_count,
        vertex_count: 4 * quad_count,
        waiting_vertex_count: 0,
        packed_first_index: 0,
    }
}
