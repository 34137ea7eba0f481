"""cuda/architectures.cmake, with an nvcc and an nvidia-smi that say what those of other machines say."""

import pathlib
import subprocess
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent
# What `nvcc --list-gpu-arch` prints.
CUDA_11_8 = [35, 37, 50, 52, 53, 60, 61, 62, 70, 72, 75, 80, 86, 87, 89, 90]
CUDA_12_4 = [50, 52, 53, 60, 61, 62, 70, 72, 75, 80, 86, 87, 89, 90]
CUDA_12_9 = [50, 52, 53, 60, 61, 62, 70, 72, 75, 80, 86, 87, 89, 90, 100, 101, 103, 120, 121]
CUDA_13_0 = [75, 80, 86, 87, 88, 89, 90, 100, 110, 103, 120, 121]


def program(path, text):
    path.write_text("#!/bin/sh\n" + text)
    path.chmod(0o755)
    return path


def architectures(known, cards=None):
    """What is chosen where nvcc knows `known` and nvidia-smi lists `cards`; None: there is no nvidia-smi."""
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        nvcc = program(folder / "nvcc", "".join(f"echo compute_{number}\n" for number in known))
        smi = "VOXSPRING_NVIDIA_SMI-NOTFOUND"
        if cards is not None:
            smi = program(folder / "nvidia-smi",
                          "".join(f"echo {card}\n" for card in cards) or "echo 'No devices were found'; exit 6\n")
        (folder / "ask.cmake").write_text(f"include({ROOT}/cuda/architectures.cmake)\n"
                                          f"voxspring_cuda_architectures(found {nvcc} {smi})\n"
                                          "message(NOTICE \"${found}\")\n")
        done = subprocess.run(["cmake", "-P", str(folder / "ask.cmake")], capture_output=True, text=True, check=False)
        return done.stderr.strip()


class Architectures(unittest.TestCase):
    def test_those_of_the_cards(self):
        self.assertEqual(architectures(CUDA_13_0, ["9.0"]), "90-real")
        self.assertEqual(architectures(CUDA_12_4, ["8.9", "8.6", "8.9"]), "89-real;86-real")

    def test_every_generation_where_there_is_no_card(self):
        for cards in None, []:
            self.assertEqual(architectures(CUDA_11_8, cards), "75-real;80-real;90-real;90-virtual")
            self.assertEqual(architectures(CUDA_12_4, cards), "75-real;80-real;90-real;90-virtual")
            self.assertEqual(architectures(CUDA_12_9, cards), "75-real;80-real;90-real;100-real;120-real;121-virtual")
            self.assertEqual(architectures(CUDA_13_0, cards),
                             "75-real;80-real;90-real;100-real;110-real;120-real;121-virtual")

    def test_every_generation_where_nvcc_does_not_know_the_card(self):
        self.assertEqual(architectures(CUDA_12_4, ["12.0"]), "75-real;80-real;90-real;90-virtual")
        self.assertEqual(architectures(CUDA_13_0, ["7.0"]),
                         "75-real;80-real;90-real;100-real;110-real;120-real;121-virtual")

    def test_says_what_nvcc_lacks(self):
        self.assertIn("lists no GPU architecture from 75 on", architectures([35, 37]))


if __name__ == "__main__":
    unittest.main()
