//! Regions of one colour (Felzenszwalb and Huttenlocher, *Efficient Graph-Based Image Segmentation*, 2004).

use super::picture::Picture;

/// Their k, for colours 0 to 1: regions join whose colours differ by no more than within each of them, plus this over their pixels.
const SCALE: f32 = 60.0 / 255.0;
/// Regions of less than this share of the picture join the neighbour that is likest.
const LEAST: usize = 800;

/// The pixels of each region, regions by their first pixel.
pub(super) fn segments(picture: &Picture) -> Vec<Vec<u32>> {
    let edges = edges(picture);
    let mut regions = Regions::new(picture.colours.len());
    for edge in &edges {
        let (a, b) = (regions.root(edge.from), regions.root(edge.to));
        if a != b && edge.weight <= regions.bound(a).min(regions.bound(b)) {
            regions.join(a, b, edge.weight);
        }
    }
    let least = (picture.colours.len() / LEAST) as u32;
    for edge in &edges {
        let (a, b) = (regions.root(edge.from), regions.root(edge.to));
        if a != b && regions.size[a as usize].min(regions.size[b as usize]) < least {
            regions.join(a, b, edge.weight);
        }
    }
    let mut number = vec![u32::MAX; picture.colours.len()];
    let mut out: Vec<Vec<u32>> = vec![];
    for pixel in 0..picture.colours.len() as u32 {
        let root = regions.root(pixel) as usize;
        if number[root] == u32::MAX {
            number[root] = out.len() as u32;
            out.push(vec![]);
        }
        out[number[root] as usize].push(pixel);
    }
    out
}

struct Edge {
    from: u32,
    to: u32,
    weight: f32,
}

/// Edges to the four neighbours that come after each pixel, by weight; equal ones in the order of their pixels.
fn edges(picture: &Picture) -> Vec<Edge> {
    let (width, height) = (picture.width, picture.height);
    let mut out = Vec::with_capacity(4 * width * height);
    for y in 0..height {
        for x in 0..width {
            let from = y * width + x;
            for (dx, dy) in [(1, 0), (-1, 1), (0, 1), (1, 1)] {
                let (x, y) = (x as i64 + dx, y + dy);
                if x < 0 || x >= width as i64 || y >= height {
                    continue;
                }
                let to = y * width + x as usize;
                let (a, b) = (picture.colours[from], picture.colours[to]);
                let weight = (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>().sqrt();
                out.push(Edge { from: from as u32, to: to as u32, weight });
            }
        }
    }
    out.sort_by(|a, b| a.weight.total_cmp(&b.weight));
    out
}

/// Union-find; what is reported for a region stands at its root.
struct Regions {
    parent: Vec<u32>,
    size: Vec<u32>,
    /// Largest weight that joined it.
    within: Vec<f32>,
}

impl Regions {
    fn new(count: usize) -> Self {
        Self { parent: (0..count as u32).collect(), size: vec![1; count], within: vec![0.0; count] }
    }

    fn root(&mut self, mut pixel: u32) -> u32 {
        while self.parent[pixel as usize] != pixel {
            let above = self.parent[self.parent[pixel as usize] as usize];
            self.parent[pixel as usize] = above;
            pixel = above;
        }
        pixel
    }

    fn bound(&self, root: u32) -> f32 {
        self.within[root as usize] + SCALE / self.size[root as usize] as f32
    }

    /// Edges come by weight, so that this one's is the largest in the joined region.
    fn join(&mut self, a: u32, b: u32, weight: f32) {
        let (root, other) = if self.size[a as usize] >= self.size[b as usize] { (a, b) } else { (b, a) };
        self.parent[other as usize] = root;
        self.size[root as usize] += self.size[other as usize];
        self.within[root as usize] = weight.max(self.within[root as usize]);
    }
}
