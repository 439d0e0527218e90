"""Films the replay of a report for README.md with headless Chromium: ``python -m docs.replay_figure``."""

import base64
import io
import sys
import tempfile
from pathlib import Path

from PIL import Image
from tests.support.browser import drive

import trackbench

FILE = Path(__file__).parent / "images" / "replay.webp"
#: Pictures, pictures in a second, and the instants of the scenario (20 Hz) from one picture to the next.
PICTURES, RATE, STEP = 66, 10, 2
#: Width of the page, pixels, and the shape of the scene.
WIDTH, SHAPE = 1000, "4 / 1"
#: Follows v3, which changes lanes, and draws scene, time line and legend of each instant into one picture.
SCRIPT = f"""
const replay = page.querySelector('.replay'), [above, line] = replay.querySelectorAll('canvas');
for (let i = 0; i < 50 && !replay.dataset.time; i++) await sleep(20);
const press = (key, times) => {{
  for (let i = 0; i < times; i++)
    replay.dispatchEvent(new KeyboardEvent('keydown', {{key, bubbles: true, cancelable: true}}));
}};
const film = [], picture = page.createElement('canvas'), follow = replay.querySelector('[name=follow]');
above.style.aspectRatio = '{SHAPE}';
const legend = [...replay.querySelectorAll('label.tracker')].map(label => ({{
  name: label.childNodes[2].textContent.trim(),
  box: label.querySelector('input'),
  colour: getComputedStyle(label.querySelector('.mark')).getPropertyValue('--mark'),
}}));
for (const it of legend) it.box.checked = ['raw', 'imm_three'].includes(it.name);
follow.value = 'v3';
follow.dispatchEvent(new Event('change'));
await sleep(100);
press('-', 3);
press('Home', 1);
for (let i = 0; i < {PICTURES}; i++) {{
  press('ArrowRight', {STEP});
  Object.assign(picture, {{width: above.width, height: above.height + line.height}});
  const pen = picture.getContext('2d');
  pen.fillStyle = 'white';
  pen.fillRect(0, 0, picture.width, picture.height);
  pen.drawImage(above, 0, 0);
  pen.drawImage(line, 0, above.height);
  pen.font = '600 14px system-ui, sans-serif';
  legend.filter(it => it.box.checked).forEach((it, place) => {{
    pen.fillStyle = it.colour;
    pen.fillText(it.name, 100 + 110 * place, 18);
  }});
  film.push(picture.toDataURL('image/png').split(',')[1]);
}}
return film;
"""


def main(folder: Path) -> None:
    """Run the scenario, and write the animation."""
    result = trackbench.run("highway", out=folder)
    film, _ = drive(folder, (folder / result.name / "report.html").read_text(encoding="utf-8"), SCRIPT, WIDTH)
    first, *others = (Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB") for png in film)
    first.save(FILE, save_all=True, append_images=others, duration=1000 // RATE, loop=0, quality=60, method=6)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder))
