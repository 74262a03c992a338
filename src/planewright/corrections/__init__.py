"""Corrections: a mark in any frame is obeyed, what follows from it is solved again, and the next mark worth making is named."""

from planewright.corrections.correct import Corrected as Corrected
from planewright.corrections.correct import CorrectionOptions as CorrectionOptions
from planewright.corrections.correct import correct as correct
from planewright.corrections.correct import settle as settle
from planewright.corrections.session import Mark as Mark
from planewright.corrections.session import Session as Session
from planewright.corrections.suggest import Suggestion as Suggestion
from planewright.corrections.suggest import suggest as suggest
