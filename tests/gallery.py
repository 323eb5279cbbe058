"""The shapes of the gallery, each made once for all tests: a shape takes a third of a second."""

from functools import cache

from core.gallery import bodies, collection
from tests import people

make_shape = cache(collection.make_shape)
make_body = cache(bodies.make_body)
make_person = cache(people.make_person)
