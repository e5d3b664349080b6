"""A lab in this process, for tests over real sockets: stations, their trainees without a screen, and a trainer."""

import json
import time

import numpy as np

from simulator_client import Client, Running
from simulator_scenes import SMALL_PAPER
from small_exercise import EXERCISE
from sonospline.course.course import Course
from sonospline.course.door import Door
from sonospline.course.lab_server import LabServer
from sonospline.lab import ResultStore
from sonospline.server import wire
from sonospline.server.exercise_catalog import ExerciseCatalog, ExerciseEntry
from sonospline.training import Exercise
from sonospline.training.attempt_recording import Recordings

TOKEN = "chalk and sponge"
ANY = bool
"""Holds of every message."""
BLOCK = EXERCISE + "[pass_mark]\npasses = {most = 1}\n"


class Lab(Running):
    """A lab with two exercises in one small scene, its results in a file."""

    def __init__(self, folder, stations=2):
        (folder / "small.toml").write_text(SMALL_PAPER)
        exercises = {
            "block": ExerciseEntry(Exercise.parse(BLOCK), folder),
            "other": ExerciseEntry(Exercise.parse(BLOCK.replace("Block, by the image", "Another block")), folder),
        }
        self.results = folder / "course.db"
        self.store = ResultStore(self.results)
        self._stations = stations
        super().__init__(ExerciseCatalog(exercises, recordings=Recordings(folder / "kept")), door=Door(TOKEN))

    def made(self, catalog, **options):
        self.course = Course(catalog, self.store, stations=self._stations, name="Tuesday", keeps_recordings=True)
        return LabServer(self.course, **options)

    def stop(self):
        super().stop()
        assert self.course.close() == 0


class Heard(Client):
    """A page that hears texts and frames until what it waits for."""

    def until(self, kind, holds=ANY, seconds=60):
        return self.until_all({kind: holds}, seconds)[kind]

    def until_all(self, wanted, seconds=60):
        """The first of each kind that holds, in whatever order they come."""
        found = {}
        end = time.monotonic() + seconds
        while found.keys() != wanted.keys():
            try:
                message = self.socket.recv(timeout=max(0, end - time.monotonic()))
            except TimeoutError:
                raise AssertionError(f"{sorted(wanted.keys() - found.keys())} was not heard") from None
            values = self.taken(message)
            kind = values.get("type")
            if kind in wanted.keys() - found.keys() and wanted[kind](values):
                found[kind] = values
        return found

    def taken(self, message):
        if isinstance(message, str):
            return json.loads(message)
        kind, header, payload = wire.read(message)
        if kind == wire.FRAME:
            self.send(type="drawn", frame=header["frame"])
            header["pixels"] = wire.read_pixels(header, payload)
        return header | {"type": kind}


class Trainee(Heard):
    """A page at a station."""

    def __init__(self, lab, station, code=None):
        super().__init__(lab, f"/live?station={station}")
        self.code, self.pictures = code, {}

    def __enter__(self):
        super().__enter__()
        if self.code is not None:
            self.state = self.until("scene")["state"]
            self.send(type="sit_down", participant=self.code)
            self.until("station", lambda said: said["participant"] == self.code)
        return self

    def taken(self, message):
        values = super().taken(message)
        if values["type"] == wire.FRAME:
            self.pictures[values["noise"]] = values["pixels"]
        return values

    def begin(self, exercise="block", **options):
        self.send(type="begin_attempt", exercise=exercise, **options)
        scene = self.until("scene", lambda said: said["attempt"] is not None)
        self.state = scene["state"]
        return scene

    def push(self, depth, steps=4):
        for share in np.linspace(1 / steps, 1, steps):
            seq = self.ask(depth=float(share * depth))
            frame = self.until(wire.FRAME, lambda header, seq=seq: header["seq"] >= seq)
        return frame


class Trainer(Heard):
    """The trainer's page."""

    def __init__(self, lab, token=TOKEN):
        super().__init__(lab, f"/trainer?trainer={token.replace(' ', '%20')}")

    def watch(self, name, **options):
        """Ask for what a station shows; return its scene."""
        self.send(type="watch_station", station=name, **options)
        return self.until("scene")

    def station(self, name, holds):
        """How a station stands, once that is so."""

        def one(said):
            return next(found for found in said["stations"] if found["name"] == name)

        return one(self.until("stations", lambda said: holds(one(said))))
